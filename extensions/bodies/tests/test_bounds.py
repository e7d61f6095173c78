"""Section 5 in space: the bounding box of each solid, against brute force over its points."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bodies import Ball, Box, Capsule, Cone, Cylinder, Matter, Mesh, Terrain, quaternion
from minerva_bodies.bounds import bounding_boxes
from minerva_bodies.rigid import Rigid
from minerva_bus import Cells, Primitive, Scene, Transformation, View, Vocabulary
from minerva_bus.grammar.scene import AgentNode

CORNERS = np.array([(0, 0, 1), (1, 0, -0.5), (-0.5, 0.8, -0.5), (-0.5, -0.8, -0.5), (3, 3, 3)])
FIXED = Matter(fixed=True)
FORMS = {
    "ball": Primitive("PBall", Ball(0.6)),
    "box": Primitive("PBox", Box("x", 0.3, 0.5), x=float),
    "capsule": Primitive("PCapsule", Capsule(0.5, 0.2)),
    "cone": Primitive("PCone", Cone(0.5, 0.4)),
    "cylinder": Primitive("PCylinder", Cylinder(0.2, 0.7)),
    "hull": Primitive("PHull", Mesh("file", 2.0), file=str),
    "mesh": Primitive("PMesh", Mesh("file", 2.0, matter=FIXED), file=str),
    "terrain": Primitive("PGround", Terrain("heights", 0.5, matter=FIXED), heights=Cells),
}
PARAMETERS = {
    "box": [0.7],
    "hull": ["tetra.obj"],
    "mesh": ["tetra.obj"],
    "terrain": [np.array([[0, 90], [-40, 20]], np.int16)],
}
NAMES = ("x", "y", "z", "w", "i", "j", "k")
TPose = Transformation("TPose", quaternion(*NAMES), **dict.fromkeys(NAMES, float))
WORDS = Vocabulary.of(*FORMS.values(), TPose)

numbers = st.floats(-1.0, 1.0).map(lambda number: round(number, 3))
poses = st.tuples(*[numbers] * 7).filter(lambda pose: np.linalg.norm(pose[3:]) > 0.1)


def sphere(radius):
    tilts, turns = np.meshgrid(
        np.linspace(-np.pi / 2, np.pi / 2, 181), np.linspace(0, 2 * np.pi, 361)
    )
    rows = np.cos(tilts) * np.cos(turns), np.cos(tilts) * np.sin(turns), np.sin(tilts)
    return radius * np.stack(rows, axis=-1).reshape(-1, 3)


def ring(radius, z):
    turns = np.linspace(0, 2 * np.pi, 721)
    return np.column_stack((radius * np.cos(turns), radius * np.sin(turns), np.full(721, z)))


POINTS = {
    "ball": sphere(0.6),
    "box": np.array([*product((-0.7, 0.7), (-0.3, 0.3), (-0.5, 0.5))]),
    "capsule": np.concatenate([sphere(0.2) + (0, 0, z) for z in (-0.5, 0.5)]),
    "cone": np.concatenate((ring(0.4, -0.5), [(0, 0, 0.5)])),
    "cylinder": np.concatenate((ring(0.7, -0.2), ring(0.7, 0.2))),
    "hull": CORNERS * 2.0,
    "mesh": CORNERS[:4] * 2.0,
    "terrain": np.array([(0, 0, 0), (0, 0.5, 0.9), (0.5, 0, -0.4), (0.5, 0.5, 0.2)]),
}


@pytest.fixture(scope="module", autouse=True)
def folder_of_mesh(tmp_path_factory):
    """A folder of Python's search path with a tetrahedron, and a point beside it."""
    folder = tmp_path_factory.mktemp("meshes")
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS.tolist()]
    (folder / "tetra.obj").write_text(
        "\n".join([*lines, "f 1 2 3", "f 1 3 4", "f 1 4 2", "f 2 4 3"])
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield


@settings(max_examples=10, deadline=None)
@given(outer=poses, inner=poses)
@pytest.mark.parametrize("form", FORMS)
def test_a_box_contains_its_solid_and_touches_it_on_all_sides(form, outer, inner):
    solid = TPose(*outer)(TPose(*inner)(FORMS[form](*PARAMETERS.get(form, ()))))
    owner = "" if form in ("mesh", "terrain") else "a"
    slots = Scene((AgentNode("ABody", "a", (), (), Scene(())),))
    view = View(0, "eBodies", slots, {"a": solid}) if owner else View(0, "eBodies", solid, {})
    pose = Rigid.quaternion(*outer).then(Rigid.quaternion(*inner))
    points = np.column_stack(pose.turned(*POINTS[form].T)) + (pose.x, pose.y, pose.z)
    (box,) = bounding_boxes(view, WORDS)
    assert (box.owner, box.symbol) == (owner, FORMS[form].name)
    for ours, brute in (
        (box.upper, points.max(axis=0)),
        (-np.array(box.lower), -points.min(axis=0)),
    ):
        # The points of round solids are at most half a degree apart.
        assert (ours - brute >= -1e-9).all()
        assert (ours - brute < 2e-4).all()


def test_boxes_are_in_the_order_of_the_string_with_their_owners():
    ball, cone = FORMS["ball"], FORMS["cone"]
    slots = [AgentNode("ABody", who, (), (), Scene(())) for who in "ba"]
    view = View(0, "eBodies", Scene((*cone().pieces, *slots)), {"a": ball() + cone(), "b": ball()})
    shown = [(box.owner, box.symbol) for box in bounding_boxes(view, WORDS)]
    assert shown == [("", "PCone"), ("b", "PBall"), ("a", "PBall"), ("a", "PCone")]
