"""The cookbook: each program runs and writes its pictures; the page has the programs."""

import runpy

import pytest

from minerva_bus import EMPTY, Disc, view
from minerva_bus.errors import MisuseError
from minerva_study import Placed
from tools.draw_cookbook import PAGE, PICTURES, PROGRAMS, RECIPES, page

LINES = {"forest": 35}


def test_the_page_has_the_programs():
    assert sorted(path.stem for path in PROGRAMS.glob("*.py")) == sorted(RECIPES)
    assert PAGE.read_text(encoding="utf-8") == page(), "python -m tools.draw_cookbook --page"


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_program_is_short_and_writes_its_pictures(recipe, tmp_path, monkeypatch):
    text = (PROGRAMS / f"{recipe}.py").read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line]) <= LINES.get(recipe, 30)
    monkeypatch.chdir(tmp_path)
    program = tmp_path / f"{recipe}.py"
    # The forest and the crowd with fewer agents, which take less time.
    program.write_text(text.replace("0_000", "00"), encoding="utf-8")
    for data in PROGRAMS.glob("*.geojson"):
        (tmp_path / data.name).write_bytes(data.read_bytes())
    runpy.run_path(str(program))
    written = {path.stem for path in tmp_path.iterdir() if path.suffix in (".svg", ".png")}
    shown = {path.stem for path in PICTURES.iterdir() if path.stem.partition("-")[0] == recipe}
    assert shown
    assert shown <= written


def test_a_class_has_its_own_picture_or_that_of_its_form():
    class Rock(Placed, form=Disc("size", "#777777")):
        size: float
        name: str = ""

    class Ghost(Rock):
        @view("ePicture")
        def picture(self, event):
            return EMPTY

    rock = Rock("r", x=1.0, y=2.0, size=3.0)
    assert str(Rock.views["ePicture"](rock, None)) == (
        'TAt<x=1, y=2, turn=0>(PRock<who="r", size=3>)'
    )
    assert (Rock.kind.name, Ghost.kind.name) == ("ARock", "AGhost")
    assert Ghost.views["ePicture"] is Ghost.picture


@pytest.mark.parametrize(
    ("color", "problem"),
    [
        ("green red black(state, 0, 3)", r"in a list: #009e73 #d55e00\(state, 0, 2\)"),
        ("magma(state, 0, 3)", "with one of viridis, inferno"),
        ("#zzz #000(state, 0, 2)", "'#zzz' is not a colour"),
        ("#12345", "expected #rrggbb or a name"),
    ],
)
def test_a_wrong_colour_is_refused_when_the_class_is_made(color, problem):
    with pytest.raises(MisuseError, match=problem):

        class Tree(Placed, form=Disc(0.3, color)):
            state: int = 0
