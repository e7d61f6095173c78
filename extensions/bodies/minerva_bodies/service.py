"""The service `bodies`: moves the bodies of a view by Rapier, and notifies their agents."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from minerva_bodies.assets import connect
from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import AXIAL
from minerva_bodies.geometry import ShownBody, SpaceGeometry
from minerva_bodies.rigid import Rigid
from minerva_bodies.sensors import SENSORS, Motions, Sensor, check_sensor, measured
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.event_factory import event_type
from minerva_services.options import check_owner, require

if TYPE_CHECKING:
    from minerva_bodies.ros2 import SpaceNode

POSE = ("x", "y", "z", "w", "i", "j", "k", "vx", "vy", "vz", "wx", "wy", "wz")
"""What an event of a pose may have: metres, a quaternion, m/s and rad/s."""
JOINT = ("joint", "first", "second", "position", "velocity")
WASM = "wasm"
ENGINES = ("rapier3d", WASM)
CONTACT = ("other", "impulse", "begins", "ends", "first", "last")


class RigidBodies(Device, Generator, coupled=True):
    """Executes the commands of each view in the following frame, and reports what has moved.

    Bodies are created in the order of the string where an agent shows solids for the first time,
    removed with their agents, and moved by physics only. `ePose` has those of `x y z w i j k vx vy
    vz wx wy wz` that its type declares; bodies at rest get none. `eContact`, if the world declares
    it, has `other` (an id, "" for scenery), `impulse` (N·s in the last step), `begins` and `ends`
    (whether it is the first frame, and the one after the last), and the frames `first` and `last`.
    `eJoint`, if declared, tells the agent in whose view a revolute or prismatic joint is: `joint`
    (its symbol), `first` and `second` (ids), `position` and `velocity` (m or degrees, per second).

    Args:
        gravity: m/s², downwards.
        draws: the visual event type of the views.
        pose: the event type of poses; "" for none.
        contact: the event type of contacts; "" for none.
        joint: the event type of joints; "" for none.
        lidar: the event type of lidars; "" for none. See `minerva_bodies.sensors`.
        imu: that of inertial units.
        distance: that of distance sensors.
        gps: that of receivers of satellite navigation.
        lost: the event type that tells an agent that its body had no finite position any more and
            has been removed, until its string shows none; "": such a body ends the world.
        every: frames between views; frames without one have no commands.
        substeps: steps of physics in a frame.
        threads: of physics; results do not depend on them.
        engine: "rapier3d", or "wasm" for Rapier as WebAssembly, which computes the same bits on
            every processor, in one thread and without rays for lidars and distance sensors.
        renew: frames after which the space is made again from its saved state, which bounds what a
            successor has to repeat; contacts lose their memory then.
        who: name of the parameter with the id of a body's agent.
        ros2: the options of `Ros2Network`, to send poses, joints and sensors to a network of ROS 2.

    """

    def __init__(
        self,
        gravity: float = 9.81,
        draws: str = "eBodies",
        pose: str = "ePose",
        contact: str = "",
        joint: str = "",
        lidar: str = "",
        imu: str = "",
        distance: str = "",
        gps: str = "",
        lost: str = "",
        every: int = 1,
        substeps: int = 1,
        threads: int = 1,
        engine: str = "rapier3d",
        renew: int = 300,
        who: str = "who",
        ros2: Mapping[str, Any] | None = None,
    ) -> None:
        require("bodies", "rapier3d", "rapier3d", "space")
        if engine not in ENGINES:
            raise BodiesError(f"bodies: engine is {engine!r}; expected {' or '.join(ENGINES)}")
        if engine == WASM:
            require("bodies", "wasmtime", "wasmtime", "wasm")
            if threads > 1 or lidar or distance:
                raise BodiesError(
                    "bodies: the engine wasm has one thread and no rays; leave out threads, lidar"
                    ' and distance, or use engine="rapier3d"'
                )
            from minerva_bodies.wasm import read_code

            read_code()
        require("bodies", "numpy", "numpy", "space")
        numbers = {"every": every, "substeps": substeps, "threads": threads, "renew": renew}
        for option, value in numbers.items():
            if not 1 <= value <= 100_000:
                raise BodiesError(f"bodies: {option} is {value}; expected 1 to 100000")
        if not abs(gravity) < 1e6:
            raise BodiesError(f"bodies: gravity is {gravity}; expected m/s², as 9.81")
        self.when = f"each {every} frames"
        self.draws = (draws,)
        self._gravity, self._substeps, self._threads = gravity, substeps, threads
        self._pose, self._contact, self._joint, self._lost = pose, contact, joint, lost
        self._senses = {"lidar": lidar, "imu": imu, "distance": distance, "gps": gps}
        self._sensors = list[Sensor]()
        self._engine_name, self._renew, self._who = engine, renew, who
        self._node: SpaceNode | None = None
        if ros2 is not None:
            from minerva_bodies.ros2 import SpaceNode  # It needs the extra ros.

            self._node = SpaceNode("bodies", ros2)
        self._shown = -1
        self._next: dict[str, Any] = {}
        self._base: dict[str, Any] = {}
        self._log: list[str] = []
        self._moved, self._receivers = list[str](), Ids.of(())
        self._arrivals: dict[str, tuple[float, Any]] = {}
        self._seconds = self._steps = self._begun = 0.0

    def generates(self) -> tuple[str, ...]:
        types = (self._pose, self._contact, self._joint, self._lost, *self._senses.values())
        return tuple(dict.fromkeys(filter(None, types)))

    def check(self, world: WorldInfo) -> None:
        check_owner("bodies", world, self._who)
        self._poses = _compared(world, self._pose, POSE) if self._pose else None
        self._contacts = _compared(world, self._contact, CONTACT) if self._contact else None
        self._ends = _compared(world, self._lost, ()) if self._lost else None
        self._turns = _compared(world, self._joint, JOINT) if self._joint else None
        self._sensed = {
            kind: _compared(world, name, SENSORS[kind])
            for kind, name in self._senses.items()
            if name
        }

    def joined(self, world: WorldInfo) -> None:
        self.check(world)
        connect(world)
        self._vocabulary, self._dt = world.vocabulary, world.dt
        self._engine = self._new()
        self._keep()
        if self._node is not None:
            self._node.open()

    def _new(self) -> Any:
        # Their modules need the libraries, which `check` does not.
        if self._engine_name == WASM:
            from minerva_bodies.wasm import WasmEngine as Engine
        else:
            from minerva_bodies.engine import Engine
        dt, removes = self._dt / self._substeps, bool(self._lost)
        return Engine(self._gravity, dt, self._threads, removes)

    def show(self, view: View) -> None:
        """φ of the view: what is new, gone and commanded, for the next frame."""
        space = SpaceGeometry(self._vocabulary, self._engine.plain, self._who)
        space.read(view)
        self._take(view, space)

    def _take(self, view: View, space: SpaceGeometry) -> None:
        for sensor in space.sensors:
            check_sensor(sensor)
            if sensor.owner not in space.seen:
                raise BodiesError(
                    f"agent {sensor.owner}, {sensor.symbol}: a sensor moves with the solids of its"
                    " agent, which shows none; add one"
                )
            if sensor.kind not in self._sensed:
                raise BodiesError(
                    f"agent {sensor.owner}, {sensor.symbol}: bodies has no event type for it; give"
                    f' it the option {sensor.kind}, such as "e{sensor.kind.capitalize()}"'
                )
        self._sensors = space.sensors
        if view.frame <= self._shown:
            return  # A successor gets the last view again, which its predecessor has executed.
        engine = self._engine
        # The scenery is a body of its own, even where there is none.
        shown = {"": space.bodies.pop("", ShownBody(Rigid())), **space.bodies}
        shown = {who: it for who, it in shown.items() if who not in engine.lost}
        joints = {
            name: plain
            for name, plain in space.joints.items()
            if engine.lost.keys().isdisjoint(plain[1])
        }
        self._next = {
            "gone": [
                name for name in (*engine.bodies, *engine.lost) if name and name not in space.seen
            ],
            "born": [[who, it.plain] for who, it in shown.items() if who not in engine.bodies],
            "changed": [
                [who, it.parts]
                for who, it in shown.items()
                if who in space.changed or (who not in space.seen and engine.solids(who))
            ],
            "follow": [[who, it.pose.numbers] for who, it in shown.items() if who and it.kinematic],
            "commands": [
                [who, *command]
                for who, it in shown.items()
                if who and who not in view.halted
                for command in it.commands
            ],
            **self._joints(joints),
        }
        self._shown = view.frame

    def _joints(self, shown: Mapping[str, list[Any]]) -> dict[str, Any]:
        """Joints that are new, gone, or have other limits and motors."""
        known = self._engine.joints
        return {
            "free": [name for name in known if name not in shown],
            "join": [[name, plain] for name, plain in shown.items() if name not in known],
            "drive": [
                [name, plain[3]]
                for name, plain in shown.items()
                if name in known and known[name][1][3] != plain[3]
            ],
        }

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        """Advance by a frame; nothing before the first view."""
        if self._shown < 0:
            return ()
        self._begun = self._begun or time.perf_counter()
        if len(self._log) >= self._renew:
            self._renewed()
        inputs, self._next = json.dumps(self._next), {}
        before, missed = self._engine.touching, {*self._engine.lost}
        motions = Motions(self._engine, self._sensors)
        moved = self._advance(inputs)
        # After the step: what fails is not part of the saved state.
        self._log.append(inputs)
        events = list(self._events(moved, before, tick.frame.number))
        lost = [name for name in self._engine.lost if name not in missed]
        if self._ends is not None and lost:
            events.append(self._ends(receivers=lost))
        data = list(self._measured(motions, tick))
        for sensor, values in data:
            kind = self._sensed[sensor.kind]
            own = {name: values[name] for name in kind.fields.names}
            events.append(kind(receivers=[sensor.owner], **own))
        if self._node is not None:
            self._node.publish(self._engine, data, round(tick.time * 1e9))
        return events

    def _measured(self, motions: Motions, tick: Tick) -> Iterable[tuple[Sensor, Mapping[str, Any]]]:
        """What sensors measure: the data of their events, or all of them if they are sent."""
        for sensor in self._sensors:
            if sensor.owner in self._engine.bodies:
                own = self._sensed[sensor.kind].fields.names
                names = own if self._node is None else SENSORS[sensor.kind]
                data = measured(sensor, self._engine, motions, tick, names, self._gravity)
                if data is not None:
                    yield sensor, data

    def _advance(self, inputs: str) -> list[str]:
        """A frame with its inputs, as text; the agents whose bodies have moved."""
        engine, given = self._engine, json.loads(inputs)
        if given:
            self._change(given)
        forced = [who for who, kind, *_ in given.get("commands", ()) if kind in ("force", "torque")]
        begin = time.perf_counter()
        moved: list[str] = engine.step(self._substeps, forced)
        self._seconds += time.perf_counter() - begin
        self._steps += self._substeps
        if self._contact:
            engine.contacts()
        self._arrivals = {
            who: engine.arrive(who, after)
            for who, _, _, after in given.get("roll", ())
            if who in engine.vehicles
        }
        return moved

    def _change(self, given: Mapping[str, Any]) -> None:
        engine = self._engine
        for joint in given.get("free", ()):
            engine.release(joint)
        for who in given.get("gone", ()):
            engine.remove(who)
        for who, plain in given.get("born", ()):
            engine.add(who, plain)
        for who, parts in given.get("changed", ()):
            engine.reshape(who, parts)
        for joint, plain in given.get("join", ()):
            engine.join(joint, plain)
        for joint, numbers in given.get("drive", ()):
            engine.drive(joint, numbers)
        for who, pose in given.get("follow", ()):
            engine.follow(who, pose)
        for who, kind, x, y, z in given.get("commands", ()):
            engine.command(who, kind, x, y, z)
        for who, turn, forward, _ in given.get("roll", ()):
            engine.roll(who, turn, forward)

    def _events(
        self, moved: list[str], before: Mapping[Any, tuple[float, int]], frame: int
    ) -> Iterable[AnyEvent]:
        names = [who for who in moved if who and who not in self._engine.vehicles]
        if names and self._poses is not None:
            rows = self._engine.rows(names)
            data = {name: rows[:, POSE.index(name)] for name in self._poses.fields.names}
            # Mostly those of the previous frame, and ids are costly to make.
            if names != self._moved:
                self._moved, self._receivers = names, Ids.of(names)
            yield self._poses(receivers=self._receivers, **data)
        if self._turns is not None:
            yield from self._positions(self._turns, {*moved})
        if self._contacts is not None:
            yield from self._touches(self._contacts, before, frame)

    def _positions(self, kind: EventType, moved: set[str]) -> Iterable[AnyEvent]:
        """A batch of the joints along an axis whose bodies have moved."""
        engine = self._engine
        joints = {
            name: plain[1]
            for name, (_, plain) in engine.joints.items()
            if plain[0] in AXIAL and not moved.isdisjoint(plain[1])
        }
        if joints:
            # The name of a joint begins with its owner and its symbol; the scenery has no agent.
            titles = [name.split("/")[:2] for name in joints]
            first, second = zip(*joints.values(), strict=True)
            position, velocity = engine.positions(list(joints)).T
            values: dict[str, Any] = {
                "joint": np.array([symbol for _, symbol in titles]),
                "first": np.array(first),
                "second": np.array(second),
                "position": position,
                "velocity": velocity,
            }
            owners = [
                owner or a or b for (owner, _), (a, b) in zip(titles, joints.values(), strict=True)
            ]
            data = {name: values[name] for name in kind.fields.names}
            yield kind(receivers=Ids.of(owners), **data)

    def _touches(
        self, kind: EventType, before: Mapping[Any, tuple[float, int]], frame: int
    ) -> Iterable[AnyEvent]:
        """An event for both agents of each pair that touches or has just parted."""
        now: Mapping[Any, tuple[float, int]] = self._engine.touching
        for pair in sorted({*now, *before}):
            ends = pair not in now
            impulse, frames = (0.0, before[pair][1]) if ends else now[pair]
            last = frame - ends
            values: dict[str, Any] = {
                "impulse": impulse,
                "begins": pair not in before,
                "ends": ends,
                "first": last - frames + 1,
                "last": last,
            }
            for who, other in (pair, pair[::-1]):
                if who in self._engine.bodies and who and who != other:
                    values["other"] = other
                    data = {name: values[name] for name in kind.fields.names}
                    yield kind(receivers=[who], **data)

    def _renewed(self) -> None:
        """Make the space again from what a successor would make it from."""
        self._keep()
        self._engine = self._new()
        self._engine.continue_from(self._base)

    def _keep(self) -> None:
        self._base, self._log = dict(self._engine.kept()), []

    def save(self) -> Mapping[str, Any]:
        """The space some frames ago, and what happened since."""
        return {**self._base, "log": "\n".join(self._log), "shown": self._shown}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Make the space of a predecessor again. Raises BodiesError for other data."""
        self._engine = self._new()
        self._engine.continue_from(saved)
        self._keep()
        try:
            self._base = {name: saved[name] for name in self._base}
            for inputs in str(saved["log"]).splitlines():
                self._advance(inputs)
                self._log.append(inputs)
            self._shown = int(saved["shown"])
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, BodiesError):
                raise
            raise BodiesError(f"not the saved state of a space of bodies: {error!r}") from error

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Number of bodies, mean duration of a step, and the share of the time in steps."""
        bodies = sum(1 for name in self._engine.bodies if name)
        passed = time.perf_counter() - self._begun if self._begun else 0.0
        share = self._seconds / passed if passed else 0.0
        sent = {} if self._node is None else {"ros2": self._node.state}
        return {
            "bodies": bodies,
            "step_ms": 1e3 * self._seconds / max(1, self._steps),
            "share_of_time": round(share, 3),
            **sent,
        }

    def close(self) -> None:
        """Leave the network of ROS 2."""
        if self._node is not None:
            self._node.close()


def _compared(world: WorldInfo, name: str, possible: tuple[str, ...]) -> EventType:
    """An event type of the world whose data are among the possible ones. Raises BodiesError."""
    declared = event_type("bodies", world, name)
    unknown = [each for each in declared.fields.names if each not in possible]
    if unknown:
        raise BodiesError(
            f"bodies: {name} declares {unknown[0]}; it may have {', '.join(possible) or 'no data'}"
        )
    return declared
