"""Robots in MJCF: bodies, joints and actuators, and files that are none."""

import math

import pytest

from minerva_bodies.errors import BodiesError
from minerva_bodies.mjcf import Mjcf

ROBOT = """<mujoco model="leg">
<compiler angle="radian" autolimits="true"/>
<include file="classes.xml"/>
<asset><material name="red" rgba="1 0 0 1"/></asset>
<worldbody>
 <light pos="0 0 3"/>
 <geom type="plane" size="0 0 1"/>
 <body name="stand" pos="0 0 1">
  <geom type="box" size=".1 .1 .1"/>
  <body name="thigh" pos="0 0 -.1" euler="0 1.5707963 0" childclass="limb">
   <inertial mass="2" pos="0 0 0"/>
   <joint name="hip"/>
   <geom fromto="0 0 0 0 0 .4" size=".05" material="red"/>
   <body name="pad" pos="0 0 .2"><geom type="sphere" size=".06"/></body>
   <body name="foot" pos="0 0 .4">
    <joint name="knee" class="stiff" pos="0 0 .01"/>
    <joint name="slide" type="slide" axis="1 0 0" range="-1 1" damping="3"/>
    <geom type="sphere" size=".1" mass="4"/>
   </body>
  </body>
 </body>
 <body name="ball" pos="1 0 1" quat="0 0 0 2"><freejoint/><geom size=".1" contype="0"/></body>
</worldbody>
<actuator>
 <motor name="push" joint="slide" gear="2"/>
 <position name="bend" joint="knee" kp="50" gear="2" ctrlrange="-1 1"/>
 <general name="turn" joint="hip" gainprm="9" biastype="affine" biasprm="0 -9 -2"/>
</actuator>
<sensor><jointpos joint="hip"/></sensor>
</mujoco>
"""
CLASSES = """<mujoco><default><geom friction=".3"/>
<default class="limb"><joint axis="0 1 0" range="-1 2"/><geom type="capsule"/>
<default class="stiff"><joint stiffness="10" springref=".5" damping="1"/></default></default>
</default></mujoco>"""


@pytest.fixture
def read(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "classes.xml").write_text(CLASSES)

    def robot(text, **options):
        (tmp_path / "r.xml").write_text(text)
        return Mjcf.read("r.xml", **options)

    return robot


def spatial(robot, name):
    return next(symbol.shape.spatial for symbol in robot.symbols if symbol.name == name)


def test_bodies_are_links_with_solids_joints_and_classes(read):
    made = read(ROBOT)
    assert [*made.links] == ["stand", "thigh", "foot_knee", "foot", "ball"]
    joints = {link: (joint.name, joint.kind, joint.parent) for link, joint in made.joints.items()}
    assert joints == {
        "thigh": ("hip", "revolute", "stand"),
        "foot_knee": ("knee", "revolute", "thigh"),
        "foot": ("slide", "prismatic", "foot_knee"),
    }
    assert made.ignored == {}
    # The capsule lies along x in the world, and its body has 2 kg.
    assert made.poses["foot"].numbers[:3] == pytest.approx((0.4, 0, 0.9), abs=1e-6)
    form, density, friction, _, fixed, *_, half, radius = spatial(made, "PLegThigh")
    assert (form, friction, fixed, half, radius) == ("capsule", 0.3, 0, 0.2, 0.05)
    volume = math.pi * 0.05**2 * (0.4 + 4 / 3 * 0.05)
    assert density == pytest.approx(2 / volume)
    assert "PLegPad" not in str(made.symbols)
    assert "PLegThigh1" in str(made.links["thigh"])
    *_, low, high = spatial(made, "PLegHipJoint")[:8]
    assert (low, high) == pytest.approx((math.degrees(-1), math.degrees(2)))
    assert "PLegWorld" in str(made.scenery)
    # What several joints hang on has 4 kg in all.
    kilos = [
        shape[1] * 4 / 3 * math.pi * shape[-1] ** 3
        for shape in (spatial(made, "PLegFoot"), spatial(made, "PLegFootKnee"))
    ]
    assert kilos == pytest.approx([3.6, 0.4])


def test_actuators_drive_joints_by_name(read):
    made = read(ROBOT)
    kinds = {name: (each.kind, each.link) for name, each in made.actuators.items()}
    assert kinds == {
        "push": ("motor", "foot"),
        "bend": ("position", "foot_knee"),
        "turn": ("position", "thigh"),
    }

    # A gear of 2 multiplies both the angle and the force; the spring rests at 0.5 rad.
    assert made.actuators["bend"].high == pytest.approx(math.degrees(0.5))
    text = str(made.driven("foot_knee", "a", "b", {"bend": 99.0}))
    target = (200 * 0.5 + 10 * 0.5) / 210
    assert f"target={math.degrees(target):.6f}"[:12] in text
    assert "stiffness=210" in text
    assert "z=0.01" in text
    # A force of 3 N by 2, of a damping of 3.
    assert "speed=2, damping=3" in str(made.driven("foot", "a", "b", {"push": 3.0}))
    with pytest.raises(BodiesError, match="no actuator 'kick'; it has push, bend, turn"):
        made.driven("foot", "a", "b", {"kick": 1.0})


def test_what_is_not_read_is_named_and_counted(read):
    other = ROBOT.replace('name="hip"', 'name="hip" armature="1" speling="2"').replace(
        "<sensor>", "<tendon/><sensor>"
    )
    other = other.replace('<geom type="box"', '<geom type="ellipsoid" size="1"/><geom type="box"')
    left = {"joint armature": 1, "joint speling": 1, "geom ellipsoid": 1, "tendon": 1}
    with pytest.raises(BodiesError, match=r"no .*geom ellipsoid \(1\).*ignore=\[.*'tendon'"):
        read(other)
    assert read(other, ignore=left).ignored == left
    assert read(other, ignore="all").ignored == left


BODY = "<mujoco><worldbody>{}</worldbody></mujoco>"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<robot/>", "line 1: the outermost element is <robot>; expected <mujoco>"),
        ("<mujoco/>", "a robot without a <body>"),
        (BODY.format("<body/>"), "the body 'body0' has no solid"),
        (BODY.format('<body name="a"/><body name="a"/>'), "the body 'a' appears twice"),
        (BODY.format('<body><joint type="screw"/></body>'), "is screw; expected hinge, slide"),
        (BODY.format('<body><joint axis="0 0 0"/></body>'), "its axis has no length"),
        (BODY.format('<body><joint range="2 1"/></body>'), "its limits are 2 to 1"),
        (BODY.format('<body><joint range="-300 0"/></body>'), "beyond 180 degrees"),
        (BODY.format("<body><joint/><freejoint/></body>"), "is free, and hangs on another"),
        (BODY.format('<body><geom type="box" size="1"/></body>'), "size='1' of <geom>; expected 3"),
        (BODY.format('<body><geom size="0"/></body>'), "a size is 0"),
        (BODY.format('<body><joint/><geom size="1" mass="0"/></body>'), "moves, and has no mass"),
        (BODY.format('<body><geom size="1" mass="-1"/></body>'), "a density of -"),
        ("<mujoco>" + 101 * '<include file="classes.xml"/>' + "</mujoco>", "more than 100 files"),
        ("<mujoco><asset><mesh file='m.stl'/><mesh file='m.stl'/></asset></mujoco>", "twice"),
        (BODY.format('<body><geom class="x"/></body>'), "there is no default class 'x'"),
        (BODY.format('<body><geom type="mesh" mesh="m"/></body>'), "there is no mesh 'm'"),
        (BODY.format('<body euler="1 2"/>'), "euler='1 2' of <body>; expected 3 numbers"),
        (BODY.format('<body quat="0 0 0 0"/>'), "quat: the rotation .* has no length"),
        (BODY.format('<body xyaxes="1 0 0 2 0 0"/>'), "xyaxes: the axes are parallel"),
        (BODY.format('<body quat="1 0 0 0" zaxis="1 0 0"/>'), "quat and zaxis; expected one"),
        ('<mujoco><include file="r.xml"/></mujoco>', "'r.xml' includes itself"),
        ('<mujoco><include file="no.xml"/></mujoco>', "include 'no.xml': there is no such file"),
        ('<mujoco><actuator><motor joint="j"/></actuator></mujoco>', "there is no joint 'j'"),
    ],
)
def test_what_is_no_robot_is_an_error_with_its_line(read, text, says):
    with pytest.raises(BodiesError, match=says) as caught:
        read(text)
    assert str(caught.value).startswith("robot 'r.xml', line ")
    assert len(str(caught.value).splitlines()) <= 10
