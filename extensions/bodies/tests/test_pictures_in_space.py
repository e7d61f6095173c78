"""Display lists of views in three dimensions."""

import math

import numpy as np
import pytest

from minerva_bodies import Ball, Box, Capsule, Command, Terrain, euler, quaternion
from minerva_bodies.pictures import MANY, SpacePictures
from minerva_bodies.rigid import Rigid
from minerva_bodies.shapes import unit_solid
from minerva_bus import (
    Agent,
    EventType,
    Label,
    Metres,
    Motion,
    Primitive,
    Transformation,
    Vocabulary,
    WorldInfo,
    view,
)
from minerva_bus.grammar.types import Cells
from minerva_bus.world.visualization import visualize
from minerva_services.geometry.picture import Copies, Lists, RepeatedText, Texts, geometry_in_space
from minerva_services.views.layout import extremes

PBox = Primitive("PBox", Box("x", 0.2, 0.1), x=Metres, who=str)
PBall = Primitive("PBall", Ball(0.5))
PPill = Primitive("PPill", Capsule(1.0, 0.5))
PHill = Primitive("PHill", Terrain("z", 2.0, ((0, "#00ff00"), (100, "#ffffff"))), z=Cells)
PSign = Primitive("PSign", Label("text"), text=str)
PLACE = dict.fromkeys("xyz", Metres) | dict.fromkeys("wijk", float)
TPose = Transformation("TPose", quaternion("x", "y", "z", "w", "i", "j", "k"), **PLACE)
TTurn = Transformation("TTurn", euler(turn="t", pitch=20, roll="r"), t=float, r=float)
TPush = Transformation("TPush", Command("force", "x", 0, 0), x=float)
TAhead = Transformation("TAhead", Motion(x=1.0, turn=30, forward="d"), d=Metres)
ePicture = EventType("ePicture", visual=True)


class Crate(Agent, symbol="ACrate"):
    x: Metres
    turn: float

    @view("ePicture", population=True)
    def picture(self, event):
        posed = TPose(self.x, 2.0, 3.0, 0.9, 0.1, self.turn, 0.3)
        return posed(
            TPush(self.x)(TTurn(self.turn, 40.0)(TAhead(0.5 + 0 * self.x)(PBox(self.x, self.id))))
        )


WORDS = Vocabulary.of(PBox, PBall, PPill, PHill, PSign, TPose, TTurn, TPush, TAhead)
WORLD = Vocabulary.of(PBox, TPose, TTurn, TPush, TAhead, ePicture, Crate)


def geometry(words):
    return geometry_in_space(WorldInfo("w", words, 0, 0.1))


def copies(scene, words=WORDS):
    return Lists(words, geometry(words)).picture(scene, {}).of(Copies)


def test_the_vocabulary_decides_about_the_geometry():
    assert isinstance(geometry(WORDS), SpacePictures)
    assert not isinstance(geometry(Vocabulary.of(PSign)), SpacePictures)


def test_columns_and_single_nodes_are_at_the_poses_of_physics():
    rng = np.random.default_rng(1)
    x, turn = rng.uniform(0.1, 3.0, 5).tolist(), rng.uniform(-170, 170, 5).tolist()
    population = Crate.many("crate", 5, x=np.array(x), turn=np.array(turn))
    scene = visualize(population, [ePicture()], [Crate])
    (together,) = copies(scene, WORLD)
    single = [copies(node, WORLD)[0] for node in map(alone, zip(x, turn, strict=True))]
    for row, each in enumerate(single):
        at = Rigid.quaternion(x[row], 2.0, 3.0, 0.9, 0.1, turn[row], 0.3)
        at = at.then(Rigid.euler(0, 0, 0, turn[row], 20, 40)).then(Rigid.euler(1, 0, 0, 30))
        expected = at.then(Rigid(0.5)).numbers
        for shown, k in ((together, row), (each, 0)):
            assert [*shown.places[k], *shown.turns[k]] == pytest.approx(expected)
            assert shown.sizes[k].tolist() == pytest.approx([x[row], 0.2, 0.1])


def alone(values):
    x, turn = values
    posed = TPose(x, 2.0, 3.0, 0.9, 0.1, turn, 0.3)
    return posed(TPush(x)(TTurn(turn, 40.0)(TAhead(0.5)(PBox(x, "crate0")))))


def test_copies_of_a_solid_are_one_item_within_their_bounds():
    turned = TPose(1.0, 0.0, 5.0, math.cos(math.pi / 8), 0.0, 0.0, math.sin(math.pi / 8))
    boxes, balls = copies(PBox(1.0, "") + PBall() + turned(PBox(1.0, "")))
    assert [len(boxes), len(balls)] == [2, 1]
    low, high = boxes.extents()
    assert high[0].tolist() == pytest.approx([1.0, 0.2, 0.1])
    reach = 1.2 * math.sqrt(0.5)
    assert low[1].tolist() == pytest.approx([1 - reach, -reach, 4.9])
    assert extremes(boxes)[0].max() == pytest.approx(1 + reach)


def test_a_terrain_has_its_colours_and_texts_stay():
    scene = PHill(np.array([[0, 0, 200], [0, 0, 200]], np.int16)) + PSign("top")
    shown = Lists(WORDS, geometry(WORDS)).picture(scene, {})
    low, peak = shown.of(Copies)
    assert low.color.tolist(), peak.color.tolist() == ([[0, 255, 0]], [[255, 255, 255]])
    assert peak.extents()[1][0].tolist() == pytest.approx([2.0, 4.0, 2.0])
    assert shown.of(Texts)[0].texts == ("top",)
    assert list(RepeatedText("a", 2)) == ["a", "a"]


@pytest.mark.parametrize("fine", [True, False])
@pytest.mark.parametrize(
    ("form", "detail", "volume"),
    [
        ("box", 0.0, 8.0),
        ("ball", 0.0, 4.189),
        ("cylinder", 0.0, 6.283),
        ("cone", 0.0, 2.094),
        ("capsule", 2.0, 16.755),
    ],
)
def test_solids_are_closed_and_seen_from_outside(form, detail, volume, fine):
    solid = unit_solid(form, detail, fine)
    a, b, c = np.moveaxis(solid.vertices[solid.faces].astype(float), 1, 0)
    signed = np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6
    assert volume * (0.93 if fine else 0.7) < signed <= volume * 1.001
    assert len(unit_solid("ball", 0.0, False).faces) < 100 < MANY
