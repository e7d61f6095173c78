"""Steps per CPU second of a pile of bricks and of cars, next to MuJoCo and PyBullet.

    python -m extensions.bodies.benchmarks.piles [--bricks 1000] [--steps 150] [--cars 1 20]

Bricks fall into a yard, and cars of a box and four driven wheels go straight on, with steps of 10
ms in one thread. The systems have the same sizes, masses, friction and motors, and their own
contacts. `world` is a whole world in one process: each brick is an agent that events tell its
pose. A system ends after `--seconds` of CPU time. The height is the mean one of all bricks at the
end, the way that of the first car. Systems whose library is not installed are left out (`pip
install mujoco pybullet`; the engine wasm as in bodies.md).
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, Final

import numpy as np

from benchmarks.command import Table, options
from minerva_bodies import Matter, Rigid
from minerva_bodies.engine import Engine
from minerva_bodies.errors import BodiesError
from minerva_bus import World, each, run, service

DT: Final = 0.01
HALF, WALL = 8.0, 0.6
BRICK: Final = (0.24, 0.12, 0.08)
DENSITY, FRICTION = 1800.0, 0.7
BODY, WHEEL = (0.5, 0.2, 0.1), (0.06, 0.2)
AXLES: Final = ((0.35, 0.3), (0.35, -0.3), (-0.35, 0.3), (-0.35, -0.3))
LIFT, SPEED, DAMPING, APART = 0.25, 400.0, 5.0, 2.0
"""Metres of an axle above the ground; degrees per second; N·m·s; metres between cars."""
UPRIGHT: Final = (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0)
WALLS: Final = (
    ((0.0, 0.0, -0.5), (HALF, HALF, 0.5)),
    ((0.0, HALF, WALL / 2), (HALF, 0.2, WALL)),
    ((0.0, -HALF, WALL / 2), (HALF, 0.2, WALL)),
    ((HALF, 0.0, WALL / 2), (0.2, HALF, WALL)),
    ((-HALF, 0.0, WALL / 2), (0.2, HALF, WALL)),
)
GROUND: Final = (((0.0, 0.0, -0.5), (300.0, 300.0, 0.5)),)
COLUMNS: Final = {"case": "<14", "system": "<24", "steps/CPU s": ">12.1f",
                  "times": ">7.2f", "steps": ">6d", "height or way, m": ">17.2f"}  # fmt: skip

Finish = Callable[[], float]


def places(count: int) -> list[Rigid]:
    """Poses of bricks in layers, as in the world rubble."""
    chance, number = np.random.default_rng(3), np.arange(count)
    x = 0.6 * (number % 10 - 4.5) + chance.uniform(-0.1, 0.1, count)
    y = 0.6 * (number // 10 % 10 - 4.5) + chance.uniform(-0.1, 0.1, count)
    turn = chance.uniform(0.0, 180.0, count)
    z = 1.0 + 0.5 * (number // 100)
    return [Rigid.euler(*map(float, at)) for at in zip(x, y, z, turn, strict=True)]


# --- this project ---------------------------------------------------------------------------------


def part(form: str, sizes: tuple[float, ...], matter: Matter, pose: Rigid | None = None) -> Any:
    return [form, list(matter.measures), list(sizes), list((pose or Rigid()).numbers)]


def fixed(engine: Any, boxes: Any) -> None:
    ground = Matter(friction=FRICTION, fixed=True)
    solids = [part("box", half, ground, Rigid(*at)) for at, half in boxes]
    engine.add("", [list(Rigid().numbers), solids])


def own_pile(kind: Any, count: int) -> tuple[Callable[[], Any], Finish]:
    engine = kind(9.81, DT, 1)
    fixed(engine, WALLS)
    names = [f"b{number}" for number in range(count)]
    for name, pose in zip(names, places(count), strict=True):
        brick = part("box", BRICK, Matter(DENSITY, FRICTION))
        engine.add(name, [list(pose.numbers), [brick]])
    return lambda: engine.step(1), lambda: float(engine.rows(names)[:, 2].mean())


def own_cars(kind: Any, count: int) -> tuple[Callable[[], Any], Finish]:
    engine = kind(9.81, DT, 1)
    fixed(engine, GROUND)
    for car in range(count):
        y = APART * car
        body = part("box", BODY, Matter(300.0, FRICTION))
        engine.add(f"c{car}", [list(Rigid(0.0, y, LIFT).numbers), [body]])
        for at, (dx, dy) in enumerate(AXLES):
            pose, name = Rigid(dx, y + dy, LIFT, *UPRIGHT), f"c{car}w{at}"
            wheel = part("cylinder", WHEEL, Matter(1000.0, FRICTION))
            engine.add(name, [list(pose.numbers), [wheel]])
            motor = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, SPEED, DAMPING]
            engine.join(name, ["revolute", [f"c{car}", name], list(pose.numbers), motor])
    return lambda: engine.step(1), lambda: float(engine.rows(["c0"])[0, 0])


def world_pile(count: int) -> World:
    from minerva_bodies.rubble import yard

    poses = np.array([pose.numbers for pose in places(count)]).T
    columns: dict[str, Any] = dict(zip("xyzwijk", poses, strict=True))
    return World(
        lambda _: yard.YARD + yard.Brick.many("brick", count, mass=16.6, **columns),
        agents=[yard.Brick],
        services=[service("bodies"), each(yard.eStep)],
        symbols=yard.vocabulary,
        order=[yard.eStep, yard.ePose],
        dt=DT,
    )


# --- others ---------------------------------------------------------------------------------------


def numbers(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def mujoco_model(bodies: str, actuators: str = "", boxes: Any = WALLS) -> Any:
    mujoco: Any = importlib.import_module("mujoco")
    walls = "".join(
        f'<geom type="box" size="{numbers(*half)}" pos="{numbers(*at)}"/>' for at, half in boxes
    )
    text = (
        f'<mujoco><option timestep="{DT}"/><size memory="2G"/>'
        f'<default><geom friction="{FRICTION}"/></default>'
        f"<worldbody>{walls}{bodies}</worldbody><actuator>{actuators}</actuator></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(text)
    return mujoco, model, mujoco.MjData(model)


def mujoco_pile(count: int) -> tuple[Callable[[], Any], Finish]:
    bodies = "".join(
        f'<body pos="{numbers(*pose.numbers[:3])}" quat="{numbers(*pose.numbers[3:])}"><freejoint/>'
        f'<geom type="box" size="{numbers(*BRICK)}" density="{DENSITY}"/></body>'
        for pose in places(count)
    )
    library, model, data = mujoco_model(bodies)
    return lambda: library.mj_step(model, data), lambda: float(data.xpos[1:, 2].mean())


def mujoco_cars(count: int) -> tuple[Callable[[], Any], Finish]:
    bodies, actuators = "", ""
    for car in range(count):
        wheels = ""
        for at, (x, y) in enumerate(AXLES):
            wheels += (
                f'<body pos="{x} {y} 0" quat="{numbers(*UPRIGHT)}"><joint name="c{car}w{at}"/>'
                f'<geom type="cylinder" size="{WHEEL[1]} {WHEEL[0]}" density="1000"/></body>'
            )
            actuators += f'<velocity joint="c{car}w{at}" kv="{DAMPING}"/>'
        bodies += (
            f'<body pos="0 {APART * car} {LIFT}"><freejoint/>'
            f'<geom type="box" size="{numbers(*BODY)}" density="300"/>{wheels}</body>'
        )
    library, model, data = mujoco_model(bodies, actuators, GROUND)
    data.ctrl[:] = math.radians(SPEED)
    return lambda: library.mj_step(model, data), lambda: float(data.xpos[1, 0])


def bullet_space(boxes: Any) -> Any:
    pybullet: Any = importlib.import_module("pybullet")
    if not pybullet.isConnected():
        pybullet.connect(pybullet.DIRECT)
    pybullet.resetSimulation()
    pybullet.setGravity(0, 0, -9.81)
    pybullet.setTimeStep(DT)
    for at, half in boxes:
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half)
        wall = pybullet.createMultiBody(0, shape, basePosition=at)
        pybullet.changeDynamics(wall, -1, lateralFriction=FRICTION)
    return pybullet


def bullet_pile(count: int) -> tuple[Callable[[], Any], Finish]:
    bullet = bullet_space(WALLS)
    shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=BRICK)
    mass, bodies = 8 * math.prod(BRICK) * DENSITY, list[int]()
    for pose in places(count):
        x, y, z, w, i, j, k = pose.numbers
        body = bullet.createMultiBody(mass, shape, -1, (x, y, z), (i, j, k, w))
        # Friction of two solids is a product there.
        bullet.changeDynamics(body, -1, lateralFriction=1.0)
        bodies.append(body)

    def height() -> float:
        return float(np.mean([bullet.getBasePositionAndOrientation(body)[0][2] for body in bodies]))

    return bullet.stepSimulation, height


def bullet_cars(count: int) -> tuple[Callable[[], Any], Finish]:
    bullet = bullet_space(GROUND)
    box = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=BODY)
    wheel = bullet.createCollisionShape(bullet.GEOM_CYLINDER, radius=WHEEL[1], height=2 * WHEEL[0])
    four = range(len(AXLES))
    cars = list[int]()
    for car in range(count):
        kilos = 2 * math.pi * WHEEL[0] * WHEEL[1] ** 2 * 1000
        w, i, j, k = UPRIGHT
        made = bullet.createMultiBody(
            8 * math.prod(BODY) * 300,
            box,
            basePosition=(0, APART * car, LIFT),
            linkMasses=[kilos for _ in four],
            linkCollisionShapeIndices=[wheel for _ in four],
            linkVisualShapeIndices=[-1 for _ in four],
            linkPositions=[(x, y, 0) for x, y in AXLES],
            linkOrientations=[(i, j, k, w) for _ in four],
            linkInertialFramePositions=[(0, 0, 0) for _ in four],
            linkInertialFrameOrientations=[(0, 0, 0, 1) for _ in four],
            linkParentIndices=[0 for _ in four],
            linkJointTypes=[bullet.JOINT_REVOLUTE for _ in four],
            linkJointAxis=[(0, 0, 1) for _ in four],
        )
        for link in four:
            bullet.changeDynamics(made, link, lateralFriction=1.0)
            bullet.setJointMotorControl2(
                made, link, bullet.VELOCITY_CONTROL, targetVelocity=math.radians(SPEED), force=50
            )
        cars.append(made)
    return bullet.stepSimulation, lambda: float(bullet.getBasePositionAndOrientation(cars[0])[0][0])


# --- the command ----------------------------------------------------------------------------------


def systems() -> dict[str, Any]:
    """Functions that make a pile and cars, by the name of the system."""
    made: dict[str, Any] = {
        "Rapier, bodies": (lambda n: own_pile(Engine, n), lambda n: own_cars(Engine, n))
    }
    if find_spec("wasmtime"):
        from minerva_bodies import wasm

        try:
            wasm.read_code()
            kind = wasm.WasmEngine
            made["Rapier, engine wasm"] = (
                lambda n: own_pile(kind, n),
                lambda n: own_cars(kind, n),
            )
        except BodiesError as error:
            print(error)
    if find_spec("mujoco"):
        made["MuJoCo"] = (mujoco_pile, mujoco_cars)
    if find_spec("pybullet"):
        made["PyBullet"] = (bullet_pile, bullet_cars)
    return made


def measured(
    made: tuple[Callable[[], Any], Finish], steps: int, seconds: float
) -> tuple[float, int, float]:
    """Steps per CPU second, how many there were, and what has become of the bodies."""
    step, finish = made
    begin, done = time.process_time(), 0
    while done < steps and time.process_time() - begin < seconds:
        step()
        done += 1
    return done / (time.process_time() - begin), done, finish()


def measured_world(count: int, steps: int) -> tuple[float, int, float]:
    """Frames of a whole world per CPU second, without its start."""
    spent, height = list[float](), 0.0
    for frames in (2, steps + 2):
        begin = time.process_time()
        done = run(world_pile(count), frames=frames, collect={"z": "mean(ABrick.z)"})
        spent.append(time.process_time() - begin)
        height = done.table().to_dict()["z"][-1]
    return steps / (spent[1] - spent[0]), steps, height


def main() -> None:
    given = options(__doc__, bricks=1000, steps=150, seconds=20.0, cars=[1, 20])
    table = Table(COLUMNS, as_json=given.json)

    def row(case: str, system: str, result: tuple[float, int, float], first: float) -> None:
        table.row({"case": case, "system": system, "steps_per_cpu_s": result[0],
                   "times": result[0] / first, "steps": result[1],
                   "metres": result[2]})  # fmt: skip

    case, first = f"{given.bricks} bricks", 0.0
    for system, (pile, _) in systems().items():
        result = measured(pile(given.bricks), given.steps, given.seconds)
        first = first or result[0]
        row(case, system, result, first)
    row(case, "world", measured_world(given.bricks, given.steps), first)
    for count in given.cars:
        first = 0.0
        for system, (_, cars) in systems().items():
            result = measured(cars(count), given.steps, given.seconds)
            first = first or result[0]
            row(f"{count} cars", system, result, first)


if __name__ == "__main__":
    main()
