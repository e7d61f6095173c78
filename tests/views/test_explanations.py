"""Legends, names of agents, marked labels and reports, in windows and pictures."""

from functools import partial
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("pygame")

from opengl_world import needs_driver
from window_world import WORDS as POND
from window_world import discs, flat, status

from minerva_bus import (
    Agent,
    Cells,
    Disc,
    EventType,
    Label,
    Metres,
    Motion,
    Primitive,
    Raster,
    Transformation,
    Vocabulary,
    on,
)
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.world.operator import LogEntry
from minerva_services.geometry.colors import DrawnColors, rgb
from minerva_services.geometry.picture import Lists, Picture
from minerva_services.views.layout import flow
from minerva_services.views.names import MAX_NAMES, agent_names
from minerva_services.views.opengl.painter import GLPainter
from minerva_services.views.reports import LatestReport
from minerva_services.views.sprites.painter import SpritePainter
from minerva_services.views.svg.document import Page, Tracer, frame_of, svg_document
from minerva_services.views.window.painter import Sight
from minerva_services.views.window.picking import Hit, pick

PBee = Primitive("PBee", Disc(0.3, "#e69f00", heading=True), name=str)
PHive = Primitive("PHive", Label("name", "#0072b2", "place of a hive"), name=str)
PGoal = Primitive("PGoal", Label("name", "#d55e00", marks=True), name=str)
PField = Primitive("PField", Raster("cells", 1.0, colors=((0, "#33aa33"),)), cells=Cells)
TPut = Transformation("TPut", Motion("x", "y"), x=Metres, y=Metres)
eHome = EventType("eHome", place=str)
eSeek = EventType("eSeek", place=str)
eWind = EventType("eWind")
ePicture = EventType("ePicture", visual=True)
GOAL = rgb("#d55e00")
SIZE = 700, 500
PAINTERS = {
    "sprites": SpritePainter,
    "opengl": pytest.param(partial(GLPainter, -90.0, 60.0, 1.0), marks=needs_driver),
}
each_painter = pytest.mark.parametrize("make", PAINTERS.values(), ids=PAINTERS.keys())


class Bee(Agent, symbol="ABee"):
    @on("eSeek")
    def seek(self, seek, moment):
        pass


MEADOW = Vocabulary.of(PBee, PHive, PGoal, PField, TPut, eHome, eSeek, eWind, ePicture, Bee)


def field(goal=""):
    """A field with a bee and two hives, one of which may be its goal."""
    bee = TPut(5.0, 2.0)(PBee("b1")) + (PGoal(goal) if goal else Scene())
    hives = TPut(1.0, 5.0)(PHive("oak")) + TPut(6.0, 5.0)(PHive("elm"))
    static = PField(np.zeros((10, 7), np.int16)) + hives
    skeleton = static + Scene((AgentNode("ABee", "b1"),))
    return Lists(MEADOW).picture(skeleton, {"b1": bee})


@pytest.fixture
def draw(make):
    made = []

    def drawn(sight, size=SIZE):
        painter = make()
        made.append(painter)
        painter.offscreen(size)
        painter.draw(sight)
        return painter, painter.pixels()

    yield drawn
    for painter in made:
        painter.close()


def count(pixels, color):
    return int((np.abs(pixels.astype(int) - np.array(color)) <= 8).all(axis=2).sum())


@each_painter
def test_the_legend_is_below_the_world_and_has_its_colours(draw):
    shown = field(goal="elm")
    painter, pixels = draw(Sight(shown, legend=shown.legend))
    _, y, _ = painter.project(*(np.array([value]) for value in (5.0, 0.0, 0.0)))
    strip = pixels[round(float(y[0])) + 4 :]
    assert 20 < len(strip) < SIZE[1] / 2
    for entry in shown.legend:
        assert count(strip[-60:], rgb(entry.colors[0])) > 10, entry.text


@each_painter
def test_a_narrow_window_has_more_rows_of_the_legend(draw):
    shown = field(goal="elm")
    ground = []
    for size in ((700, 400), (200, 400)):
        painter, _ = draw(Sight(shown, legend=shown.legend), size)
        corners = [np.array([value]) for value in (0.0, 0.0, 0.0)]
        ground.append(size[1] - float(painter.project(*corners)[1][0]))
    assert ground[1] > ground[0]


@each_painter
def test_a_click_on_the_name_of_an_agent_selects_it(draw):
    shown = field()
    painter, _ = draw(Sight(shown, names=agent_names(shown)))
    (box,) = [box for box in painter.labels() if box.text == "b1"]
    nowhere = partial(flat)
    middle = (box.left + box.right) / 2, (box.top + box.bottom) / 2
    assert pick(Picture(), nowhere, painter.labels(), middle) == Hit(agent="b1")
    (oak,) = [box for box in painter.labels() if box.text == "oak"][-1:]
    middle = (oak.left + oak.right) / 2, (oak.top + oak.bottom) / 2
    assert pick(Picture(), nowhere, painter.labels(), middle) == Hit(label="oak")


@each_painter
def test_a_marked_label_has_the_colour_of_the_mark(draw):
    without, with_mark = (draw(Sight(field(goal)))[1] for goal in ("", "elm"))
    assert count(without, GOAL) == 0
    assert count(with_mark, GOAL) > 60


@each_painter
def test_a_window_names_the_key_for_help(draw):
    plain, hinted = (
        draw(Sight(field(), caption="pond", hint=hint))[1] for hint in ("", "? shows keys")
    )
    assert (plain != hinted).any(axis=2).sum() > 100


def test_a_picture_has_a_legend_names_and_marked_labels():
    bee, hives = TPut(5.0, 2.0)(PBee("b1")), TPut(1.0, 5.0)(PHive("oak"))
    scene = PField(np.zeros((10, 7), np.int16)) + hives + bee + PGoal("oak")
    drawn = DrawnColors()
    page = Page(frame_of(scene, MEADOW, None, drawn), 600)
    shown = drawn.legend(MEADOW)
    root = ElementTree.fromstring(
        svg_document(scene, MEADOW, page, Tracer(), "bees", "frame 1", shown)
    )
    (legend,) = root.findall("{*}g[@class='legend']")
    texts = [text.text for text in legend.findall("{*}text")]
    assert texts == ["bee", "goal", "place of a hive", "field"]
    assert int(root.attrib["height"]) > page.height
    labels = {text.text: text.attrib.get("fill") for text in root.findall("{*}g/{*}text")}
    assert labels["oak"] == "#d55e00"
    assert "b1" in labels


def test_names_are_those_of_agents_with_a_heading_unless_there_are_too_many():
    first, still = discs((0.0, 0.0), (1.0, 2.0)), discs((5.0, 5.0), owners=["p1"], heading=False)
    names = agent_names(Picture((first, still, first)))
    assert [(name.text, name.x, name.y) for name in names] == [("b1", 0.0, 0.0), ("b2", 1.0, 2.0)]
    places = [(float(x), 0.0) for x in range(MAX_NAMES + 1)]
    assert len(agent_names(Picture((discs(*places[:-1]),)))) == MAX_NAMES
    assert agent_names(Picture((discs(*places),))) == ()


def test_rows_are_filled_and_never_empty():
    assert flow([4.0, 4.0, 4.0], 9.0, 1.0) == [[0, 1], [2]]
    assert flow([20.0, 4.0], 9.0, 1.0) == [[0], [1]]
    assert flow([], 9.0, 1.0) == []


def test_the_latest_report_of_an_agent_is_in_plain_words():
    reports = LatestReport(MEADOW)
    entries = [
        LogEntry(1, 10, "eHome", 'eHome<place="oak"> from #b1'),
        LogEntry(2, 11, "eSeek", 'eSeek<place="elm"> from #b2'),  # agents respond to it
        LogEntry(3, 12, "eWind", "eWind"),  # it has no sender
    ]
    reports.update(status(happenings=tuple(entries)))
    assert reports.text == "b1 home: oak (1.0 s)"
    assert reports.last == 3
    reports.update(status(happenings=(entries[0],)))
    assert reports.last == 3
    assert LatestReport(POND).text == ""
