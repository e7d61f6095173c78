"""docs/geometries.md and examples/ascii: the page shows the folder's code, and it runs."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from minerva_bus import (
    Cells,
    Disc,
    Label,
    Metres,
    Motion,
    Primitive,
    Raster,
    Scene,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
)
from minerva_bus.frame.member_side import Member
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.specs import find_service
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from tests.one_process import run_file

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples" / "ascii"
DOCUMENT = (ROOT / "docs" / "geometries.md").read_text(encoding="utf-8")


def blocks(kind: str) -> list[str]:
    return re.findall(rf"^```{kind}\n(.*?)^```$", DOCUMENT, re.M | re.S)


def block(kind: str) -> str:
    (text,) = blocks(kind)
    return text


def show(spec: str, world: str, frames: int) -> None:
    """Run a world and let a device of the folder show only the last frame."""
    file = read_world_file(find_world(world), Overrides(frames=frames))
    device = find_service(spec, FOLDER)()
    device.when = "each 1000000 frames"
    run_file(file, Member("ascii", device))


@pytest.mark.parametrize(
    ("kind", "file"), [("python symbols", "ascii_view.py"), ("python forms", "any_world.py")]
)
def test_the_page_has_the_code_that_is_in_the_folder(kind: str, file: str):
    assert block(kind) == (FOLDER / file).read_text(encoding="utf-8")


def test_thirty_lines_are_a_geometry():
    assert sum(bool(line.strip()) for line in block("python symbols").splitlines()) <= 30


def test_the_test_on_the_page_passes():
    done = subprocess.run(
        [sys.executable, "-c", block("python test")],
        cwd=FOLDER,
        env={"PYTHONPATH": ":".join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("spec", ["ascii_view:Ascii", "any_world:Ascii"])
def test_the_robot_is_in_its_office(spec: str, capsys: pytest.CaptureFixture[str]):
    show(spec, "robot", 5)
    sheets = capsys.readouterr().out
    last = sheets[len(sheets) // 2 :]
    assert len(re.findall("[>^<v]", re.sub("[a-z]{3,}", "", last))) == 1
    for name in ("library", "store", "meeting", "office", "workshop"):
        assert re.search(name[0] + "?" + name[1:], last), name
    assert last.count("#") > 500


def test_the_page_shows_what_the_code_makes(capsys: pytest.CaptureFixture[str]):
    show("ascii_view:Ascii", "robot", 1)
    made, shown = capsys.readouterr().out.splitlines()[:24], blocks("text")[0].splitlines()
    assert len(made) == len(shown)
    changed = [
        (left, right)
        for line, there in zip(made, shown, strict=True)
        for left, right in zip(line.ljust(72), there.ljust(72), strict=True)
        if left != right
    ]
    assert len(changed) <= 4, changed


def test_every_world_is_drawn_by_forms(capsys: pytest.CaptureFixture[str]):
    wall = Primitive("PWall", Raster("cells", 1.0, height=1.0), cells=Cells)
    carpet = Primitive("PCarpet", Raster("cells", 1.0), cells=Cells)
    cart, ball = Primitive("PCart", Disc(0.1, heading=True)), Primitive("PBall", Disc(0.1))
    sign = Primitive("PSign", Label("words"), words=str)
    at = Transformation("TAt", Motion("x", "y", "turn"), x=Metres, y=Metres, turn=float)
    words = Vocabulary.of(wall, carpet, cart, ball, sign, at)
    device = find_service("any_world:Ascii", FOLDER)()
    device.joined(WorldInfo("hall", words, 0, 0.1))
    cells = np.zeros((76, 8), np.int16)
    cells[0, :] = 100
    scene: Scene = wall(cells) + carpet(cells + 1)
    scene += at(10.0, 5.0, 90.0)(cart() + at(0.0, -20.0, 0.0)(ball())) + at(4.0, 3.0, 0.0)(
        sign("hi")
    )
    device.show(View(0, "ePicture", scene))  # type: ignore[attr-defined]
    device.show(View(1, "ePicture", Scene(())))  # type: ignore[attr-defined]
    assert capsys.readouterr().out.splitlines() == [
        "#",
        "#         ^                   *",
        "#   hi",
        "#",
    ]
