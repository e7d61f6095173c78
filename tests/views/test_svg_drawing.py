"""SVG drawings: places, markup, the part of the world that they show, and traced matrices."""

import gc
import random
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray
from svg_world import (
    VOCABULARY,
    PBall,
    PInner,
    PMap,
    PPath,
    PRobot,
    PSign,
    PUgly,
    TMove,
    TStill,
    elements,
    page_of,
    picture,
)

from minerva_bus import EMPTY, MinervaError, Scene
from minerva_bus.grammar.columns import Columns
from minerva_bus.semantics.plane import Bounds
from minerva_bus.semantics.poses import Pose
from minerva_services.views.svg.document import (
    Page,
    Tracer,
    exact,
    frame_of,
    line_of_text,
    paint,
    short,
    trace,
)

FLOOR = PMap(np.zeros((20, 10), np.int16), 1.0, -5.0, -5.0)


def circles(scene: Scene) -> list[tuple[float, float, float]]:
    """Centre and radius of each disc, in metres of the world."""
    frame = page_of(scene).frame
    return [
        (
            frame.left + float(e.attrib["cx"]),
            frame.bottom + float(e.attrib["cy"]),
            float(e.attrib["r"]),
        )
        for e in elements(picture(scene), "circle")
    ]


def test_a_disc_is_where_nested_transformations_lead():
    scene = FLOOR + TMove(1.0, 2.0, 90.0)(TMove(0.5, 0.0, -45.0, 2.0)(PBall(0.5)))
    there = Pose().then(1.0, 2.0, 90.0, 0.0).then(0.5, 0.0, -45.0, 2.0)
    assert circles(scene) == [pytest.approx((there.x, there.y, 0.5), abs=1e-3)]


def test_poses_compose_and_are_restored_for_any_nesting():
    chance = random.Random(3)
    for _ in range(50):
        motions = [[chance.uniform(-3, 3) for _ in range(4)] for _ in range(chance.randrange(6))]
        scene, there = PBall(0.25), Pose()
        for motion in reversed(motions):
            scene = TMove(*motion)(scene)
        for motion in motions:
            there = there.then(*motion)
        discs = circles(FLOOR + scene + PBall(0.5))
        assert discs[0] == pytest.approx((there.x, there.y, 0.25), abs=1e-3)
        assert discs[1] == pytest.approx((0.0, 0.0, 0.5), abs=1e-3)


def test_a_transformation_without_motion_moves_nothing():
    assert circles(FLOOR + TStill()(PBall(1.0))) == [pytest.approx((0.0, 0.0, 1.0), abs=1e-3)]


def test_the_heading_mark_points_ahead():
    scene = FLOOR + TMove(2.0, 1.0, 90.0)(PRobot())
    frame = page_of(scene).frame
    tip = elements(picture(scene), "polygon")[0].attrib["points"].split()[0]
    x, y = (float(number) for number in tip.split(","))
    assert frame.left + x == pytest.approx(2.0, abs=1e-3)
    assert frame.bottom + y == pytest.approx(1.0 + 0.78 * 0.25, abs=1e-3)


def test_a_line_goes_through_its_points():
    scene = FLOOR + TMove(1.0, 1.0, 90.0)(PPath((0.0, 2.0, 2.0), (0.0, 0.0, 1.0)))
    line = elements(picture(scene), "polyline")[0].attrib
    assert line["points"] == "6,6 6,8 5,8"
    assert line["stroke-linejoin"] == "round"
    assert "stroke-dasharray" in line


def test_a_label_stands_at_its_pixel_and_above_all_else():
    scene = PSign("here") + FLOOR + PRobot()
    document = picture(scene)
    x, y = page_of(scene).pixel(5.0, 5.0)
    assert f"translate({x:.15g} {y:.15g})" in document
    assert document.index("here") > document.index("polygon")


def test_a_label_that_would_leave_the_picture_turns_to_the_left():
    scene = FLOOR + TMove(14.5, 0.0)(PSign("a long way to go"))
    text = next(e for e in elements(picture(scene), "text") if e.text == "a long way to go")
    assert text.attrib["text-anchor"] == "end"


def test_figures_are_drawn_in_the_order_of_the_string():
    document = picture(FLOOR + PBall(1.0) + PPath((0.0, 1.0), (0.0, 1.0)) + PRobot())
    order = [document.index(part) for part in ('#fbfaf6" d=', "#123456", "#aa0000", "#e07a2f")]
    assert order == sorted(order)


def test_a_disc_too_small_to_see_is_drawn_larger():
    scene = PMap(np.zeros((2, 2), np.int16), 1000.0) + PBall(0.1)
    assert circles(scene)[0][2] * page_of(scene).scale == pytest.approx(3.0, abs=0.01)


def test_a_small_place_far_away_is_drawn_to_the_pixel():
    scene = TMove(5e5, 4.5e6)(PBall(0.001) + TMove(0.01)(PBall(0.001)))
    left, right = circles(scene)
    assert right[0] - left[0] == pytest.approx(0.01, abs=1e-4)
    assert float(elements(picture(scene), "circle")[0].attrib["cx"]) < 1.0


def test_a_string_that_draws_nothing_is_an_empty_picture():
    assert elements(picture(EMPTY), "circle") == []
    assert elements(picture(TMove(1.0)(PInner())), "circle") == []


@pytest.mark.parametrize("place", [1e300, -1e300, 1e-300, 1e12])
def test_no_place_is_too_far_for_a_picture(place: float):
    document = picture(TMove(place, place)(PRobot()) + PRobot())
    assert len(elements(document, "circle")) == 2
    assert len(document) < 5000


def test_a_colour_that_is_none_is_refused():
    with pytest.raises(MinervaError, match="is not a colour"):
        picture(PUgly())


HOSTILE = [
    "</text></svg><script>alert(1)</script>",
    "<![CDATA[ ]]> &amp; &lt; &#0; <!-- -->",
    "\"quotes\" 'apostrophes' \\ % {braces}",
    "\x00\x01\x1b[31m\ufffe\uffff",
    "žluťoučký 東京 🤖",
    "line\nbreak\ttab\r\n",
    "x" * 1_000_000,
    "",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_a_hostile_label_stays_a_text(text: str):
    document = picture(PSign(text))
    document.encode()
    root = ElementTree.fromstring(document)
    tags = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert tags <= {"svg", "title", "rect", "g", "path", "circle", "text", "tspan"}
    assert len(document) < 6000


def test_a_label_reads_as_it_was_written():
    shown = [e.text for e in elements(picture(PSign("<A & B> 'žluť' 東京")), "text")]
    assert "<A & B> 'žluť' 東京" in shown


def test_texts_are_cut_to_one_line():
    assert line_of_text("a\n b\t\tc ") == "a b c"
    assert line_of_text("\ud800\x00a") == "\ufffd\ufffda"
    assert line_of_text("x" * 100) == "x" * 59 + "…"


def test_numbers_are_short():
    assert [short(n) for n in (1.0, 0.12345, -2.5, 1e300, 123456.7894)] == [
        "1", "0.123", "-2.5", "1000000000", "123456.789",
    ]  # fmt: skip
    assert exact(0.0375) == "0.0375"


def test_colours_are_colours():
    assert [paint(c) for c in ("#123", "#A0b1C2", "teal")] == ["#123", "#A0b1C2", "teal"]


def test_rasters_frame_the_picture():
    scene = TMove(50.0)(PBall(1.0)) + PMap(np.zeros((4, 2), np.int16), 0.5) + PBall(9.0)
    assert frame_of(scene, VOCABULARY) == Bounds(0.0, 0.0, 2.0, 1.0)


def test_without_rasters_everything_is_on_the_picture_with_a_margin():
    frame = frame_of(PPath((0.0, 10.0), (0.0, 8.0)), VOCABULARY)
    assert frame.left < 0 < 10 < frame.right
    assert frame.bottom < 0 < 8 < frame.top


def test_without_rasters_the_frame_only_grows():
    near = frame_of(PPath((0.0, 10.0), (0.0, 8.0)), VOCABULARY)
    assert frame_of(TMove(5.0, 5.0)(PBall(1.0)), VOCABULARY, near) is near
    far = frame_of(TMove(30.0)(PBall(1.0)), VOCABULARY, near)
    assert near.around(far) == far
    assert frame_of(EMPTY, VOCABULARY, far) is far


def test_a_lone_disc_does_not_fill_the_picture():
    frame = frame_of(PBall(0.25), VOCABULARY)
    assert frame.right - frame.left == pytest.approx(8 * 0.25)


def test_a_population_in_columns_is_drawn_as_its_nodes():
    n = 40
    at = {"x": np.linspace(0.0, 9.0, n), "y": np.zeros(n), "turn": np.linspace(0.0, 300.0, n)}
    moves = [TMove(x=x, y=y, turn=turn) for x, y, turn in zip(*at.values(), strict=True)]
    for columns, single in (
        (TMove(**at)(PRobot()), [move(PRobot()) for move in moves]),
        (
            TMove(**at)(PBall(at["x"])),
            [move(PBall(x)) for move, x in zip(moves, at["x"], strict=True)],
        ),
    ):
        assert any(isinstance(piece, Columns) for piece in columns.pieces)
        nodes = EMPTY
        for scene in single:
            nodes += scene
        assert picture(columns) == picture(nodes)


def test_a_crowd_has_no_outlines():
    few, crowd = (TMove(x=np.arange(n) * 1.0)(PRobot()) for n in (1000, 1001))
    assert ['stroke="none" stroke-opacity' in picture(scene) for scene in (few, crowd)] == [
        False,
        True,
    ]


def test_y_grows_upwards():
    page = Page(Bounds(0.0, 0.0, 10.0, 10.0), 1000)
    assert page.pixel(0.0, 1.0)[1] < page.pixel(0.0, 0.0)[1] < page.height
    assert page.pixel(1.0, 0.0)[0] > page.pixel(0.0, 0.0)[0]


@pytest.mark.parametrize(("x", "y"), [(1000.0, 0.0), (0.0, 1000.0), (1.0, 1.0)])
def test_no_world_makes_a_picture_too_flat_or_too_tall(x: float, y: float):
    page = page_of(PPath((0.0, x), (0.0, y)))
    assert 0.2 < page.height / page.width < 1.7


def test_a_point_is_enough_for_a_picture():
    frame = page_of(PSign("x")).frame
    assert frame == Bounds(-frame.right, -frame.top, frame.right, frame.top)
    assert 1.0 < frame.right < 2.0


@pytest.mark.parametrize("size", [0.003, 1.0, 30.0, 9000.0])
def test_the_grid_has_round_steps_and_few_lines(size: float):
    page = Page(Bounds(0.0, 0.0, size, size), 1200)
    assert 8 <= size / page.grid_step <= 20
    assert f"{page.grid_step:.0e}"[0] in "125"


COLORS = ((-1, "#111111"), (0, ""), (1, "#222222"), (100, "#333333"))
_RECTANGLE = re.compile(r"M(\d+) (\d+)h(\d+)v(\d+)h-(\d+)z")


def painted(paths: tuple[tuple[str, str], ...], shape: tuple[int, ...]) -> NDArray[np.object_]:
    """The colour of each cell; fails if two rectangles overlap."""
    cells = np.full(shape, "", object)
    for color, data in paths:
        assert _RECTANGLE.sub("", data) == ""
        for rectangle in _RECTANGLE.findall(data):
            row, column, rows, columns, back = map(int, rectangle)
            assert rows == back
            area = cells[row : row + rows, column : column + columns]
            assert area.shape == (rows, columns)
            assert (area == "").all()
            area[:] = color
    return cells


def expected(cells: NDArray[np.int16]) -> NDArray[np.object_]:
    def color(value: int) -> str:
        return next((color for least, color in reversed(COLORS) if value >= least), "")

    return np.array([[color(value) for value in row] for row in cells], object)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (7, 5), (12, 110), (120, 11)])
@pytest.mark.parametrize("seed", range(4))
def test_every_cell_has_its_colour_once(shape: tuple[int, int], seed: int):
    random = np.random.default_rng(seed)
    cells = random.choice([-2, -1, 0, 1, 99, 100], shape).astype(np.int16)
    cells[:, shape[1] // 2 :] = cells[:1, :1]
    assert (painted(trace(cells, COLORS), shape) == expected(cells)).all()


def test_a_plain_area_is_one_rectangle():
    assert trace(np.full((600, 300), 5, np.int16), COLORS) == (("#222222", "M0 0h600v300h-600z"),)


def test_rectangles_that_only_touch_are_not_merged():
    cells = np.zeros((3, 4), np.int16)
    cells[2, 0:2] = cells[0, 2:4] = 1
    assert (painted(trace(cells, COLORS), cells.shape) == expected(cells)).all()


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0)])
def test_an_empty_matrix_has_no_paths(shape: tuple[int, int]):
    assert trace(np.empty(shape, np.int16), COLORS) == ()


def test_values_without_colour_have_no_paths():
    assert trace(np.zeros((3, 3), np.int16), COLORS) == ()
    assert trace(np.full((3, 3), -9, np.int16), COLORS) == ()
    assert trace(np.ones((3, 3), np.int16), ()) == ()


def test_a_matrix_of_reals_is_traced_too():
    assert trace(np.array([[0.5, 1.5]]), COLORS) == (("#222222", "M0 1h1v1h-1z"),)


def test_a_read_only_matrix_is_traced_once_while_it_lives():
    tracer = Tracer()
    cells = np.ones((3, 3), np.int16)
    cells.flags.writeable = False
    first = tracer.paths(cells, COLORS)
    assert tracer.paths(cells, COLORS) is first
    assert tracer.paths(cells, ((1, "#999999"),)) != first
    del cells
    gc.collect()
    assert tracer._known == {}  # pyright: ignore[reportPrivateUsage]


def test_a_writable_matrix_is_traced_again():
    tracer = Tracer()
    cells = np.ones((3, 3), np.int16)
    first = tracer.paths(cells, COLORS)
    cells[0, 0] = 100
    assert tracer.paths(cells, COLORS) != first
