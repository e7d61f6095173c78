"""The PNG: the raster equals the matrix, and text is legible on any machine."""

import functools
import sys

import numpy as np
import pytest

pytest.importorskip("resvg_py")

import resvg_py
from numpy.typing import NDArray
from svg_world import FREE, UNKNOWN, WALL, PHeat, PMap, PSign, TMove, page_of, picture, pixels

from minerva_bus import MinervaError, Scene
from minerva_bus.semantics.poses import Pose
from minerva_services.views.svg.rendering import font_options, png

COLORS = {-1: UNKNOWN, 0: FREE, 100: WALL}


def color_at(scene: Scene, x: float, y: float, image: NDArray[np.uint8]) -> str:
    frame, page = page_of(scene).frame, page_of(scene)
    right, down = page.pixel(x - frame.left, y - frame.bottom)
    return "#" + bytes(image[int(down), int(right)]).hex()


@pytest.mark.parametrize(
    ("x", "y", "turn", "outside"),
    [(0.0, 0.0, 0.0, Pose()), (3.0, -2.0, 90.0, Pose()), (1.0, 1.0, 30.0, Pose(4.0, 5.0, -75.0))],
)
def test_a_raster_is_its_matrix(x: float, y: float, turn: float, outside: Pose):
    cells = np.random.default_rng(1).choice([-1, 0, 100], (12, 7)).astype(np.int16)
    scene = TMove(outside.x, outside.y, outside.angle)(PMap(cells, 0.37, x, y, turn))
    image, corner = pixels(png(picture(scene))), outside.then(x, y, turn, 0.0)
    page = page_of(scene)
    for (row, column), value in np.ndenumerate(cells):
        centre = corner.then((row + 0.5) * 0.37, (column + 0.5) * 0.37, 0.0, 0.0)
        # The grid's faint lines may pass through a centre, but not through a pixel beside it.
        near = {
            color_at(scene, centre.x + dx / page.scale, centre.y + dy / page.scale, image)
            for dx in (-4, 0, 4)
            for dy in (-4, 0, 4)
        }
        assert COLORS[int(value)] in near
        assert not near & (set(COLORS.values()) - {COLORS[int(value)]})


def test_opacity_mixes_with_what_is_below():
    scene = PMap(np.zeros((2, 2), np.int16), 0.5) + PHeat(np.array([[0.0, 1.0], [1.0, 0.0]]))
    image = pixels(png(picture(scene)))
    mixed = tuple(
        round((a + b) / 2) for a, b in zip(bytes.fromhex(FREE[1:]), (255, 0, 0), strict=True)
    )
    color = bytes.fromhex(color_at(scene, 0.23, 0.73, image)[1:])
    assert all(abs(a - b) <= 1 for a, b in zip(color, mixed, strict=True))
    assert color_at(scene, 0.23, 0.23, image) == FREE


def dark(scene: Scene) -> int:
    """The number of pixels of the map's panel that are as dark as letters."""
    top, height = page_of(scene).padding, page_of(scene).panel[1]
    image = pixels(png(picture(scene)))[round(top) + 30 : round(top + height)]
    return int((image.sum(axis=2) < 300).sum())


def test_text_shows():
    floor = PMap(np.zeros((6, 3), np.int16), 1.0)
    assert dark(floor) == 0
    assert dark(floor + TMove(2.0, 1.0)(PSign("legible"))) > 200


def test_text_shows_on_a_machine_without_fonts(monkeypatch: pytest.MonkeyPatch):
    bare = functools.partial(resvg_py.svg_to_bytes, skip_system_fonts=True)
    monkeypatch.setattr(resvg_py, "svg_to_bytes", bare)
    font_options.cache_clear()
    try:
        test_text_shows()
    finally:
        font_options.cache_clear()


def test_a_missing_font_is_reported_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    bare = functools.partial(resvg_py.svg_to_bytes, skip_system_fonts=True)
    monkeypatch.setattr(resvg_py, "svg_to_bytes", bare)
    monkeypatch.setitem(sys.modules, "PIL", None)
    font_options.cache_clear()
    try:
        png(picture(PSign("x")))
        png(picture(PSign("y")))
    finally:
        font_options.cache_clear()
    assert capsys.readouterr().err.count("\n") == 1


def test_a_document_that_resvg_refuses_is_a_clear_error():
    with pytest.raises(MinervaError, match="resvg cannot render it"):
        png("<svg")
