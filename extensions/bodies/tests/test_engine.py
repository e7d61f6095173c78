"""Bodies against mechanics, and a space that is made again from its saved state."""

import json
import math

import numpy as np
import pytest

pytest.importorskip("rapier3d", reason="needs the extra space")

from minerva_bodies import Matter, Rigid
from minerva_bodies.engine import Engine
from minerva_bodies.errors import BodiesError

DT = 1 / 200
HERE = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


def space(threads=1, dt=DT):
    return Engine(9.81, dt, threads)


def at(x=0.0, y=0.0, z=0.0):
    return [x, y, z, *HERE[3:]]


def solid(form, *sizes, pose=HERE, **material):
    return [form, list(Matter(**material).measures), list(sizes), pose]


def axis(x=0, y=0, z=1, low=0, high=0, target=0, stiffness=0, speed=0, damping=0):
    return [*map(float, (x, y, z, low, high, target, stiffness, speed, damping))]


def floor(engine, tilt=0.0, friction=0.0):
    """A floor whose top is z = 0, turned about y so that it descends along x."""
    pose = Rigid.euler(0, 0, 0, pitch=tilt).then(Rigid(0, 0, -1))
    part = solid("box", 50.0, 50.0, 1.0, pose=list(pose.numbers), friction=friction)
    engine.add("", [HERE, [part]])


def run(engine, seconds, dt=DT):
    for _ in range(round(seconds / dt)):
        engine.step(1)


def row(engine, name="a"):
    return engine.rows([name])[0]


def test_a_body_falls_as_galileo_says():
    engine = space()
    engine.add("a", [at(z=100.0), [solid("ball", 0.1)]])
    engine.command("a", "velocity", 3.0, 0.0, 4.0)
    run(engine, 2.0)
    x, _, z = row(engine)[:3]
    assert (x, z) == pytest.approx((6.0, 100 + 8 - 0.5 * 9.81 * 4), abs=9.81 * 2 * DT)
    assert row(engine)[9] == pytest.approx(4 - 2 * 9.81, abs=1e-3)


@pytest.mark.parametrize(("tilt", "slides"), [(20.0, False), (35.0, True)])
def test_a_box_slides_where_the_slope_exceeds_its_friction(tilt, slides):
    engine = space()
    floor(engine, tilt, friction=0.5)
    pose = Rigid.euler(0, 0, 0, pitch=tilt).then(Rigid(0, 0, 0.1))
    engine.add("a", [list(pose.numbers), [solid("box", 0.2, 0.2, 0.1, friction=0.5)]])
    run(engine, 1.0)
    moved = math.hypot(row(engine)[0] - pose.x, row(engine)[2] - pose.z)
    angle = math.radians(tilt)
    ideal = 0.5 * 9.81 * max(0.0, math.sin(angle) - 0.5 * math.cos(angle))
    assert moved == pytest.approx(ideal, rel=0.1, abs=0.01)
    assert (moved > 0.1) == slides


def test_a_pendulum_has_its_period():
    engine = space()
    engine.add("", [HERE, []])
    engine.add("a", [at(x=0.05, z=-1.0), [solid("ball", 0.02)]])
    engine.join("hinge", ["revolute", ["", "a"], HERE, axis(0, 1, 0)])
    xs = []
    for _ in range(1000):
        engine.step(1)
        xs.append(row(engine)[0])
    crossings = np.flatnonzero(np.diff(np.sign(xs)) != 0) * DT
    period = 2 * np.diff(crossings).mean()
    assert period == pytest.approx(2 * math.pi * math.sqrt(math.hypot(1, 0.05) / 9.81), rel=0.01)


def test_motors_limits_and_joints_hold():
    engine = space()
    engine.add("", [HERE, []])
    for name, kind, numbers in (
        ("wheel", "revolute", axis(speed=90, damping=100)),
        ("lift", "prismatic", axis(low=-0.5, high=0.5)),
        ("fixed", "fixed", axis()),
        ("chain", "spherical", axis()),
    ):
        place = len(engine.bodies) * 10.0
        engine.add(name, [at(x=place), [solid("box", 0.2, 0.2, 0.2)]])
        engine.join(name, [kind, ["", name], at(x=place), numbers])
    run(engine, 2.0)
    assert row(engine, "wheel")[12] == pytest.approx(math.pi / 2, rel=0.02)
    assert row(engine, "lift")[2] == pytest.approx(-0.5, abs=0.01)
    assert row(engine, "fixed")[2] == pytest.approx(0, abs=0.01)
    assert row(engine, "chain")[2] == pytest.approx(0, abs=0.01)
    engine.drive("wheel", axis(speed=-90, damping=100))
    run(engine, 1.0)
    assert row(engine, "wheel")[12] == pytest.approx(-math.pi / 2, rel=0.02)
    engine.remove("chain")
    assert list(engine.joints) == ["lift", "fixed", "wheel"]


def test_motors_hold_a_target_and_limits_hold_an_angle():
    engine = space()
    engine.add("", [HERE, []])
    for place, (kind, numbers) in enumerate((
        ("revolute", axis(1, 0, 0, target=60, stiffness=1000, damping=10)),
        ("prismatic", axis(target=0.4, stiffness=10000, damping=100)),
        ("revolute", axis(1, 0, 0, high=30)),
        ("spherical", axis(low=-30, high=30)),
    )):  # fmt: skip
        name = f"{kind}{place}"
        hung = solid("ball", 0.1, pose=at(y=0.5))
        engine.add(name, [at(x=10.0 * place), [hung]])
        engine.join(name, [kind, ["", name], at(x=10.0 * place), numbers])
    # 1000 N·m per radian hold the ball, whose torque is 10 N·m, within a degree.
    run(engine, 4.0)
    turned, lifted, stopped = engine.positions(["revolute0", "prismatic1", "revolute2"])
    assert turned == pytest.approx((60, 0), abs=1)
    assert lifted == pytest.approx((0.4, 0), abs=0.01)
    assert stopped[0] == pytest.approx(0, abs=1)
    i = row(engine, "spherical3")[4]
    assert math.degrees(2 * math.asin(abs(i))) == pytest.approx(30, abs=2)


def test_positions_of_joints_are_those_of_their_bodies_while_both_move():
    engine = space()
    engine.add("a", [at(z=5), [solid("box", 0.2, 0.2, 0.2)]])
    engine.add("b", [at(z=6), [solid("box", 0.1, 0.2, 0.3)]])
    engine.add("c", [at(y=1, z=5), [solid("box", 0.2, 0.1, 0.2)]])
    engine.join("turn", ["revolute", ["a", "b"], at(z=5.5), axis(1, 2, 3)])
    engine.join("slide", ["prismatic", ["a", "c"], at(y=0.5, z=5), axis(1, 0, 1)])
    engine.command("b", "twist", 1.0, 2.0, 3.0)
    engine.command("c", "impulse", 9.0, 0.0, 9.0)
    run(engine, 0.05)
    before = engine.positions(["turn", "slide"])
    for _ in range(20):
        engine.step(1)
        after = engine.positions(["turn", "slide"])
        # Across the end of the circle, too.
        moved = (after[:, 0] - before[:, 0] + 180) % 360 - 180
        assert moved / DT == pytest.approx((after[:, 1] + before[:, 1]) / 2, rel=0.05, abs=0.05)
        before = after
    assert abs(before[:, 1]).min() > 0.1


def pile(threads=1, count=60):
    engine = space(threads, dt=0.02)
    floor(engine, friction=0.5)
    forms = (("box", 0.2, 0.1, 0.1), ("ball", 0.15), ("cylinder", 0.1, 0.1), ("capsule", 0.1, 0.1))
    for number in range(count):
        form, *sizes = (*forms, ("cone", 0.1, 0.1))[number % 5]
        place = at(0.3 * (number % 4), 0.25 * (number // 4 % 4), 0.5 + 0.3 * (number // 16))
        engine.add(f"b{number}", [place, [solid(form, *sizes)]])
    return engine


def test_a_pile_has_the_same_bits_with_any_number_of_threads():
    one, two = pile(), pile(threads=2)
    for engine in (one, two):
        run(engine, 2.0, 0.02)
    names = [name for name in one.bodies if name]
    assert (one.rows(names) == two.rows(names)).all()
    assert one.contacts() == two.contacts() != {}


def test_a_space_made_again_continues_as_any_other_made_from_the_same():
    first = pile()
    floor_joint = ["fixed", ["", "b0"], HERE, axis()]
    first.join("nail", floor_joint)
    run(first, 1.0, 0.02)
    first.contacts()
    kept, names = first.kept(), [name for name in first.bodies if name]
    again = [space(dt=0.02), space(threads=2, dt=0.02)]
    for engine in again:
        engine.continue_from(kept)
        assert (engine.rows(names)[:, :3] == first.rows(names)[:, :3]).all()
        assert engine.kept()["bodies"] == kept["bodies"]
        assert engine.touching == first.touching
        run(engine, 1.0, 0.02)
    assert (again[0].rows(names) == again[1].rows(names)).all()


def test_rows_are_what_the_library_says():
    engine = pile(count=5)
    run(engine, 0.5, 0.02)
    body = engine._world.rigid_bodies[engine.bodies["b3"]]
    i, j, k, w = body.rotation.i, body.rotation.j, body.rotation.k, body.rotation.w
    listed = [*body.translation.to_tuple(), w, i, j, k, *body.linvel.to_tuple()]
    assert row(engine, "b3").tolist() == [*listed, *body.angvel.to_tuple()]


def test_bodies_at_rest_are_not_reported_and_a_command_wakes_them():
    engine = space(dt=0.02)
    floor(engine, friction=0.5)
    engine.add("a", [at(z=0.1), [solid("box", 0.1, 0.1, 0.1)]])
    engine.add("b", [at(x=5.0, z=0.1), [solid("box", 0.1, 0.1, 0.1)]])
    run(engine, 10.0, 0.02)
    assert engine.step(1) == []
    engine.command("b", "impulse", 1.0, 0.0, 1.0)
    assert engine.step(1) == ["b"]


def test_a_kinematic_body_pushes_and_groups_pass_each_other():
    engine = space(dt=0.02)
    floor(engine)
    engine.add("blade", [at(z=0.2), [solid("box", 0.1, 0.1, 0.1, kinematic=True)]])
    engine.add("a", [at(x=0.25, z=0.1), [solid("box", 0.1, 0.1, 0.1, group=3)]])
    engine.add("b", [at(x=0.25, z=0.1), [solid("box", 0.1, 0.1, 0.1, group=3)]])
    for step in range(1, 51):
        engine.follow("blade", at(x=0.02 * step, z=0.2))
        engine.step(1)
    assert row(engine, "blade")[0] == pytest.approx(1.0)
    assert row(engine, "a")[0] == pytest.approx(row(engine, "b")[0], abs=0.05)
    assert row(engine, "a")[0] > 1.1


def test_a_kinematic_body_goes_a_part_of_its_way_in_each_substep():
    """A box on a plate that moves steadily goes with it, however many substeps a frame has."""
    engine = space()
    engine.add("plate", [at(0, 0, 0), [solid("box", 5.0, 1.0, 0.1, kinematic=True)]])
    engine.add("box", [at(0, 0, 0.3), [solid("box", 0.2, 0.2, 0.2)]])
    for number in range(200):
        engine.follow("plate", at(0.01 * number, 0, 0))
        engine.step(4)
    assert row(engine, "box")[0] == pytest.approx(row(engine, "plate")[0], abs=0.1)


def test_terrain_and_meshes_carry(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "ramp.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    )
    engine = space(dt=0.02)
    heights = np.full((11, 11), 50.0).tolist()
    engine.add("", [HERE, [solid("terrain", heights, 1.0)]])
    engine.add("a", [at(5, 5, 1), [solid("ball", 0.2)]])
    engine.add("m", [at(8, 8, 1), [solid("mesh", "ramp.obj", 0.5)]])
    run(engine, 3.0, 0.02)
    assert row(engine)[2] == pytest.approx(0.7, abs=0.02)
    assert 0.4 < row(engine, "m")[2] < 0.9


@pytest.mark.parametrize(("file", "says"), [("none.obj", "no such file"), ("flat.obj", "open")])
def test_a_mesh_that_is_none_leaves_no_body(tmp_path, monkeypatch, file, says):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "flat.obj").write_bytes(b"v 0 0 1\nv 0 0 2\nv 0 0 3\nf 1 2 3")
    engine = space()
    with pytest.raises(BodiesError, match=says):
        engine.add("a", [HERE, [solid("mesh", file, 1.0)]])
    assert engine.bodies == {}


def test_a_joint_between_strangers_is_an_error():
    engine = space()
    with pytest.raises(BodiesError, match="joint j: no body of 'ghost'"):
        engine.join("j", ["fixed", ["ghost", "a"], HERE, axis()])


def test_a_body_without_a_finite_position_is_an_error_with_its_agent():
    engine = space()
    engine.add("a", [HERE, [solid("ball", 1e-6, density=1e-12)]])
    engine.command("a", "velocity", 3e38, 0.0, 0.0)
    with pytest.raises(BodiesError, match="the body of 'a' has no finite position"):
        run(engine, 60.0)


@pytest.mark.parametrize("data", [{}, {"rows": b"x"}, {"rows": b"", "bodies": json.dumps([[1]])}])
def test_other_data_are_no_saved_state(data):
    with pytest.raises(BodiesError, match="not the saved state"):
        space().continue_from(data)
