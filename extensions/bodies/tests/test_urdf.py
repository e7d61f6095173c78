"""Robots in URDF: their links and joints, and files that are none."""

import hashlib
import math

import pytest

from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import FIXED
from minerva_bodies.urdf import Urdf

LINK = '<link name="{}"><collision><geometry>{}</geometry></collision></link>\n'
A = LINK.format("a", '<box size="1 2 3"/>')
B = LINK.format("fore_arm", '<cylinder radius="1" length="2"/>')
JOINT = (
    '<joint name="j" type="{}"><parent link="a"/><child link="fore_arm"/>\n'
    '<origin xyz="1 0 2" rpy="0 0 1.5707963"/><axis xyz="0 0 1"/>{}</joint>'
)
LIMIT = '<limit lower="-1" upper="2"/>'


@pytest.fixture
def read(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)

    def robot(text, **options):
        (tmp_path / "r.urdf").write_text(text)
        return Urdf.read("r.urdf", **options)

    return robot


def robot(*parts):
    return f'<robot name="my_robot">\n{"".join(parts)}\n</robot>'


def test_a_robot_has_links_joints_and_symbols(read):
    made = read(robot(A, B, JOINT.format("revolute", LIMIT)))
    assert [*made.links] == ["a", "fore_arm"]
    joint = made.joints["fore_arm"]
    assert (joint.kind, joint.parent) == ("revolute", "a")
    place = 1, 0, 2, math.sqrt(0.5), 0, 0, math.sqrt(0.5)
    assert made.poses["fore_arm"].numbers == pytest.approx(place, abs=1e-6)
    *_, low, high = joint.primitive.shape.spatial[:8]
    assert (low, high) == pytest.approx((math.degrees(-1), math.degrees(2)))
    names = ["TPlace", "PMyRobotA", "PMyRobotForeArm", "PMyRobotJJoint"]
    assert [symbol.name for symbol in made.symbols] == names
    text = str(made.joint("fore_arm", "x", "y", target=30.0, stiffness=5.0))
    assert text.startswith('PMyRobotJJoint<parent="x", child="y", target=30, stiffness=5')


def test_links_at_fixed_joints_are_a_part_of_their_parent(read):
    made = read(robot(A, B, JOINT.format("fixed", "")))
    assert [*made.links] == ["a"]
    assert not made.joints
    assert "PMyRobotForeArm" in str(made.links["a"])
    # All solids of a body are moved in the same way.
    assert [symbol.shape.spatial[4] for symbol in made.symbols[1:]] == [FIXED, FIXED]


def test_the_mass_of_a_link_gives_its_density(read):
    heavy = A.replace("</link>", '<inertial><mass value="12"/></inertial></link>')
    first, _ = read(robot(heavy), fixed=False).symbols[1], None
    assert first.shape.spatial[1] == pytest.approx(2.0)  # 12 kg in 6 m³


@pytest.mark.parametrize("file", ["../parts/t.obj", "package://parts/t.obj"])
def test_meshes_have_digests_by_which_views_get_them_from_other_members(tmp_path, read, file):
    text = robot(LINK.format("a", f'<mesh filename="{file}"/>'))
    for folder in ("parts", "robots"):
        (tmp_path / folder).mkdir()
    surface = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    (tmp_path / "parts/t.obj").write_bytes(surface)
    (tmp_path / "robots/r.urdf").write_text(text)
    made = Urdf.read("robots/r.urdf")
    digest = hashlib.sha256(surface).hexdigest()
    assert made.symbols[1].fields.all[0].default == f"parts/t.obj#sha256={digest[:16]}"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<robot", "line 1: no XML: unclosed token"),
        ('<!DOCTYPE r [<!ENTITY a "b">]>\n<robot name="&a;"/>', "line 1: a document type"),
        ('<?xml version="1.0" encoding="rot13"?><robot/>', "line 1: no XML: "),
        (
            robot("<xacro:include/>").replace(">", ' xmlns:xacro="x">', 1),
            "line 2: <xacro:include> is",
        ),
        ("<world/>", "line 1: the outermost element is <world>"),
        (robot(), "line 1: a robot without a <link>"),
        (robot(A, A), "line 3: the link 'a' appears twice"),
        (robot(A, B), "line 1: 2 links have no parent"),
        (robot(A, B, JOINT.format("a&#10;b", "")), "line 4: the joint 'j' is a b; expected"),
        (robot(A, B, JOINT.format("revolute", "")), "line 4: the joint 'j' has no <limit>"),
        (robot(A, JOINT.format("fixed", "")), "line 3: the joint 'j': there is no link 'fore_arm'"),
        (robot(A, B, JOINT.format("revolute", LIMIT)).replace("1 0 2", "1 x 2"), "line 5: xyz"),
        (robot(A, B, JOINT.format("revolute", LIMIT)).replace("0 0 1", "0 0 nan"), "line 5: "),
        (robot(LINK.format("a", '<box size="1 2"/>')), "line 2: size='1 2' of <box>; expected 3"),
        (robot(LINK.format("a", '<torus radius="1"/>')), "line 2: the geometry <torus>"),
        (robot(LINK.format("a", '<mesh filename="no.stl"/>')), "line 2: mesh 'no.stl'"),
        (robot(LINK.format("a", '<mesh filename="../../t.obj"/>')), "line 2: .* without .."),
        (robot(LINK.format("a", '<mesh filename="/t.obj"/>')), "line 2: .* below a folder"),
        (robot('<link name="a"/>'), "line 2: the link 'a' has no solid"),
        (robot('<link name="a">' * 40), "too many elements"),
        (robot(LINK.format("a", '<sphere radius="0"/>')), "line 2: .*a size is 0"),
    ],
)
def test_what_is_no_robot_is_an_error_with_its_line(read, text, says):
    with pytest.raises(BodiesError, match=says) as caught:
        read(text)
    assert str(caught.value).startswith("robot 'r.urdf', line ")
    assert len(str(caught.value).splitlines()) <= 10
