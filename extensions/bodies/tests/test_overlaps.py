"""Section 5 in space: which solids of a string overlap, against brute force."""

from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

pytest.importorskip("rapier3d", reason="needs the extra space")
pytest.importorskip("scipy", reason="brute force needs a convex hull")

from scipy.spatial import ConvexHull

from minerva_bodies import Ball, Box, Matter, Mesh, quaternion
from minerva_bodies.errors import BodiesError
from minerva_bodies.rigid import Rigid
from minerva_bodies.service import ENGINES, RigidBodies
from minerva_bus import EventType, Primitive, Scene, Tick, Transformation, View, Vocabulary
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.world.context import Frame
from minerva_bus.world.services import WorldInfo

GHOST = Matter(kinematic=True, sensor=True)
CORNERS = np.array([(0, 0, 1), (1, 0, -0.5), (-0.5, 0.8, -0.5), (-0.5, -0.8, -0.5)])
FACES = [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]
HALVES = np.array((0.7, 0.3, 0.5))

FORMS = {
    "box": Primitive("PBox", Box(*HALVES.tolist(), matter=GHOST)),
    "ball": Primitive("PBall", Ball(0.6, matter=GHOST)),
    "mesh": Primitive("PMesh", Mesh("file", 1.0, matter=GHOST), file=str),
}
PNothing = Primitive("PNothing", Ball(0.6, matter=Matter(kinematic=True, sensor=True, group=-1)))
NAMES = ("x", "y", "z", "w", "i", "j", "k")
TPose = Transformation("TPose", quaternion(*NAMES), **dict.fromkeys(NAMES, float))
eContact = EventType("eContact", other=str, begins=bool)
eBodies = EventType("eBodies", visual=True)
INFO = WorldInfo(
    "yard", Vocabulary.of(*FORMS.values(), PNothing, TPose, eContact, eBodies), 7, 0.02
)

numbers = st.floats(-1.0, 1.0).map(lambda number: round(number, 3))
solids = st.tuples(st.sampled_from(sorted(FORMS)), *[numbers] * 3, *[numbers] * 4)


def pieces(form, pose):
    """Convex pieces: corners and a radius. The surface of a mesh has nothing inside."""
    points = {
        "box": [HALVES * signs for signs in product((-1, 1), repeat=3)],
        "ball": [(0, 0, 0)],
        "mesh": CORNERS,
    }[form]
    placed = [np.array(pose.turned(*point)) + (pose.x, pose.y, pose.z) for point in points]
    rows = FACES if form == "mesh" else [range(len(placed))]
    return [(np.array([placed[row] for row in face]), 0.6 * (form == "ball")) for face in rows]


def gap(ours, theirs):
    """Metres between two convex pieces, below 0 where they overlap.

    The difference of two polytopes is one whose supporting planes go through three of its corners.
    """
    (left, radius), (right, other) = ours, theirs
    corners = (left[:, None] - right[None]).reshape(-1, 3)
    if len(corners) == 1:
        return float(np.linalg.norm(corners[0])) - radius - other
    return nearest(corners) - radius - other


def nearest(corners):
    """The signed distance of the origin from the convex hull of points."""
    hull = ConvexHull(corners, qhull_options="QJ") if len(corners) > 3 else None
    faces = [(0, 1, 2)] if hull is None else hull.simplices
    outside = 1.0 if hull is None else float(hull.equations[:, 3].max())
    if outside <= 0.0:
        return outside
    return min(to_triangle(*corners[list(face)]) for face in faces)


def to_triangle(a, b, c):
    """The distance of the origin from a triangle."""
    normal = np.cross(b - a, c - a)
    sides = [np.dot(np.cross(q - p, -p), normal) for p, q in ((a, b), (b, c), (c, a))]
    if min(sides) >= 0.0 and normal.any():
        return abs(float(np.dot(a, normal))) / float(np.linalg.norm(normal))
    return min(to_edge(p, q) for p, q in ((a, b), (b, c), (c, a)))


def to_edge(p, q):
    way = q - p
    share = np.clip(-np.dot(p, way) / max(float(np.dot(way, way)), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(p + share * way))


@pytest.fixture(scope="module", params=ENGINES)
def engine(request):
    """The name of an engine that is installed."""
    try:
        RigidBodies(engine=request.param)
    except (BodiesError, MisuseError) as error:
        pytest.skip(str(error))
    return request.param


@settings(max_examples=25, deadline=None)
@given(pair=st.tuples(solids, solids))
def test_solids_overlap_where_brute_force_finds_it(engine, folder_of_mesh, pair):
    assume(all(np.linalg.norm(numbers[3:]) > 0.1 for _, *numbers in pair))
    shown, placed = {}, []
    for who, (form, *numbers) in zip("ab", pair, strict=True):
        solid = FORMS[form]("tetra.obj") if form == "mesh" else FORMS[form]()
        shown[who] = TPose(*numbers)(solid)
        placed.append(pieces(form, Rigid.quaternion(*numbers)))
    least = min(gap(*both) for both in product(*placed))
    assume(abs(least) > 1e-3)  # Rapier computes in single precision.
    expected = [("a", "b"), ("b", "a")] if least < 0.0 else []
    assert overlaps(joined(engine), 1, **shown) == expected


def joined(engine):
    service = RigidBodies(gravity=0.0, pose="", contact="eContact", engine=engine)
    service.joined(INFO)
    return service


def overlaps(service, number, **shown):
    """Receivers and others of the contacts in a frame."""
    slots = [AgentNode("ABody", who, (), (), Scene(())) for who in shown]
    service.show(View(number - 1, "eBodies", Scene(tuple(slots)), shown))
    events = single(service.generate(Tick(Frame(number, 0.02, 7), "bodies")))
    return [(event.receivers[0], event.other) for event in events]


def test_a_contact_is_that_before_the_last_step_and_group_minus_1_has_none(engine):
    service, here = joined(engine), TPose(0, 0, 0, 1, 0, 0, 0)
    ball, ghost = FORMS["ball"](), here(PNothing())
    seen = [
        overlaps(service, number, a=here(ball), b=TPose(x, 0, 0, 1, 0, 0, 0)(ball), c=ghost)
        for number, x in enumerate((3.0, 0.5, 0.5), 1)
    ]
    assert seen == [[], [], [("a", "b"), ("b", "a")]]


@pytest.fixture(scope="module")
def folder_of_mesh(tmp_path_factory):
    """A folder of Python's search path with a tetrahedron."""
    folder = tmp_path_factory.mktemp("meshes")
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS.tolist()]
    lines += ["f " + " ".join(str(at + 1) for at in face) for face in FACES]
    (folder / "tetra.obj").write_text("\n".join(lines))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield folder
