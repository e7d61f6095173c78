"""Bounding volumes of a view: places, sizes and agents."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from minerva_bus import (
    EMPTY,
    Cells,
    Degrees,
    Disc,
    Label,
    Line,
    Metres,
    Motion,
    Primitive,
    Raster,
    Scene,
    Transformation,
    Vocabulary,
)
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.semantics.plane import bounds
from minerva_services.geometry.volumes import Bodies, Volumes, mask_rectangles, volumes

PDisc = Primitive("PDisc", Disc("radius"), radius=Metres)
PBody = Primitive("PBody", Disc(0.5), who=str)
PWall = Primitive("PWall", Line("xs", "ys", width=0.2), xs=tuple[float, ...], ys=tuple[float, ...])
PMap = Primitive("PMap", Raster("cells", "cell", "x", "y", colors=((0, "#fff"), (2, "#000")), height=1.0), cells=Cells, cell=Metres, x=Metres, y=Metres)  # fmt: skip
PFlat = Primitive("PFlat", Raster("cells", 1.0), cells=Cells)
PText = Primitive("PText", Label("text"), text=str)
PSound = Primitive("PSound")
TMove = Transformation("TMove", Motion("x", "y"), x=Metres, y=Metres)
TTurn = Transformation("TTurn", Motion(turn="angle"), angle=Degrees)
TGo = Transformation("TGo", Motion(forward="dist"), dist=Metres)
TOf = Transformation("TOf", who=str)
VOCABULARY = Vocabulary.of(PDisc, PBody, PWall, PMap, PFlat, PText, PSound, TMove, TTurn, TGo, TOf)


def found(scene: Scene) -> Volumes:
    return volumes(scene, VOCABULARY)


def cores(volumes: Volumes) -> list[list[tuple[float, float]]]:
    ends = zip(volumes.first[:-1], volumes.first[1:], strict=True)
    return [[(x, y) for x, y in volumes.points[a:b].tolist()] for a, b in ends]


def test_a_disc_is_where_transformations_lead() -> None:
    scene = TMove(1.0, 2.0)(TTurn(90.0)(TGo(3.0)(PDisc(0.25))) + PDisc(1.0))
    shapes = found(scene)
    assert shapes.points == pytest.approx(np.array([[1.0, 5.0], [1.0, 2.0]]))
    assert shapes.radius.tolist() == [0.25, 1.0]


def test_a_line_is_its_segments_and_half_its_width_around() -> None:
    shapes = found(TMove(1.0, 0.0)(PWall((0.0, 2.0, 2.0), (0.0, 0.0, 1.0))))
    assert cores(shapes) == [[(1.0, 0.0), (3.0, 0.0)], [(3.0, 0.0), (3.0, 1.0)]]
    assert shapes.radius.tolist() == [0.1, 0.1]
    assert shapes.symbols.tolist() == ["PWall", "PWall"]


@pytest.mark.parametrize("points", [((1.0,), (2.0,)), ((1.0, 1.0), (2.0, 2.0))])
def test_a_line_of_one_place_is_a_disc(points: tuple[tuple[float, ...], ...]) -> None:
    assert cores(found(PWall(*points))) == [[(1.0, 2.0)]]


def test_cells_that_stand_are_boxes_counter_clockwise() -> None:
    cells = np.array([[2, 3, 1], [2, 2, 0], [1, 0, 2]], np.int16)
    shapes = found(TTurn(90.0)(PMap(cells, 0.5, 1.0, 0.0)))
    assert [len(core) for core in cores(shapes)] == [4, 4]
    corners = np.array(cores(shapes)[0])
    assert corners == pytest.approx(np.array([[0, 1], [0, 2], [-1, 2], [-1, 1]]))


def test_shapes_without_height_and_texts_have_no_contacts() -> None:
    flat = PFlat(np.ones((3, 3), np.int16))
    assert len(found(flat + PText("exit") + PSound() + PWall((), ()) + EMPTY)) == 0


def slot(name: str, kind: str = "AFox") -> Scene:
    return Scene((AgentNode(kind, name),))


def test_figures_belong_to_their_agent_or_to_the_scenery() -> None:
    skeleton = PDisc(9.0) + slot("f") + TMove(5.0, 0.0)(slot("g") + PDisc(8.0))
    shapes = Bodies(VOCABULARY).volumes(skeleton, {"f": PDisc(1.0), "g": PDisc(2.0)})
    rows = zip(shapes.radius, shapes.owners, shapes.kinds, shapes.points[:, 0], strict=True)
    assert sorted(rows) == [
        (1, "f", "AFox", 0),
        (2, "g", "AFox", 5),
        (8, "", "", 5),
        (9, "", "", 0),
    ]


def test_a_figure_may_name_its_agent() -> None:
    inner = PBody("in") + PDisc(1.0) + TOf("deep")(PDisc(2.0) + PBody("own"))
    shapes = Bodies(VOCABULARY).volumes(slot("out"), {"out": inner})
    assert shapes.owners.tolist() == ["in", "out", "deep", "own"]
    assert set(shapes.kinds) == {"AFox"}


def test_a_population_must_name_the_agent_of_each_figure() -> None:
    x = np.arange(3.0)
    ids = np.array(["a", "b", "c"], object)
    bodies = Bodies(VOCABULARY)
    shapes = bodies.volumes(slot("~0"), {"~0": TMove(x, x)(PBody(ids))})
    assert shapes.owners.tolist() == ["a", "b", "c"]
    assert shapes.points[:, 1].tolist() == [0, 1, 2]
    for nameless in (TMove(x, x)(PDisc(1.0)), PDisc(1.0)):
        with pytest.raises(MisuseError, match=r"PDisc in the view of .* AFox has no owner"):
            bodies.volumes(slot("~0"), {"~0": nameless})


def test_unchanged_parts_are_not_interpreted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    bodies, skeleton = Bodies(VOCABULARY), slot("f") + slot("g")
    parts = {"f": PBody("f"), "g": PBody("g")}
    bodies.volumes(skeleton, parts)
    interpreted: list[str] = []
    geometry = bodies._views._geometry
    place = geometry.shape
    monkeypatch.setattr(
        geometry,
        "shape",
        lambda shape, figure: (interpreted.append(figure.parameters["who"]), place(shape, figure)),
    )
    parts = parts | {"g": TMove(1.0, 1.0)(PBody("g"))}
    assert bodies.volumes(skeleton, parts).points[:, 0].tolist() == [0, 1]
    assert interpreted == ["g"]


angles = st.integers(-720, 720).map(float)
numbers = st.integers(-64, 64).map(lambda number: number / 7)


@given(st.lists(st.tuples(numbers, numbers, angles, numbers), min_size=1, max_size=40), angles)
@settings(max_examples=40)
def test_columns_lead_where_their_rows_lead_to_the_last_bit(
    rows: list[tuple[float, ...]], around: float
) -> None:
    x, y, angle, dist = (np.array(column) for column in zip(*rows, strict=True))
    ids = np.array([f"a{n}" for n in range(len(rows))], object)
    population = TMove(x, y)(TTurn(angle)(TGo(dist)(TMove(y, x)(PBody(ids)))))
    one_by_one = EMPTY
    for name, (dx, dy, turn, far) in zip(ids, rows, strict=True):
        one_by_one += TMove(dx, dy)(TTurn(turn)(TGo(far)(TMove(dy, dx)(PBody(name)))))
    population, one_by_one = (TTurn(around)(string) for string in (population, one_by_one))
    held, plain = found(population), found(one_by_one)
    assert held.points.tobytes() == plain.points.tobytes()
    assert held.owners.tolist() == plain.owners.tolist()


@given(st.lists(st.tuples(numbers, numbers, angles), min_size=1, max_size=9))
@settings(max_examples=40)
def test_boxes_around_volumes_are_the_bounds_of_the_string(places: list[tuple[float, ...]]) -> None:
    figures = [
        PDisc(0.3),
        PWall((0.0, 1.0), (0.0, 2.0)),
        PMap(np.full((2, 3), 2, np.int16), 0.5, 1.0, 1.0),
    ]
    scene = EMPTY
    for number, (x, y, angle) in enumerate(places):
        scene += TMove(x, y)(TTurn(angle)(figures[number % 3]))
    lower, upper = found(scene).boxes()
    around = bounds(scene, VOCABULARY)
    assert around is not None
    assert lower.min(axis=0) == pytest.approx((around.left, around.bottom))
    assert upper.max(axis=0) == pytest.approx((around.right, around.top))


@given(arrays(np.bool_, st.tuples(st.integers(0, 9), st.integers(1, 9))))
@settings(max_examples=60)
def test_rectangles_cover_what_is_true_and_each_cell_once(cells: np.ndarray) -> None:
    covered = np.zeros(cells.shape, int)
    for row, column, rows, columns in mask_rectangles(cells):
        covered[row : row + rows, column : column + columns] += 1
    assert (covered == cells).all()


def test_a_room_has_four_walls() -> None:
    cells = np.ones((9, 7), bool)
    cells[1:-1, 1:-1] = False
    assert len(mask_rectangles(cells)) == 4
