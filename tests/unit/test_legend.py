"""Legends explain the primitives of a picture by their declared meanings or their names."""

import re

import msgpack
import numpy as np
import pytest

from minerva_bus import (
    Cells,
    Disc,
    EventType,
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
from minerva_bus.wire.plain import unpack
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary
from minerva_services.geometry.colors import SCALES, LegendEntry, legend, rgb, words
from minerva_services.geometry.picture import Lists, Marks, Picture, Texts, combined
from minerva_services.views.svg.document import Page, Tracer, frame_of, svg_document

PFir = Primitive("PFirTree", Disc(0.3, "#009e73"))
PSign = Primitive("PSign", Label("text", "#0072b2", "name of a place"), text=str)
PWanted = Primitive("PWanted", Label("text", "#d55e00", marks=True), text=str)
PWay = Primitive("PWay", Line("xs", "ys", dashed=True), xs=tuple[float, ...], ys=tuple[float, ...])
PSoil = Primitive(
    "PSoil",
    Raster(
        "cells",
        1.0,
        colors=((0, "#ffffff"), (1, ""), (2, "#000000")),
        opacity=0.5,
        meanings=("", "nothing", "stones"),
    ),
    cells=Cells,
)
PGrass = Primitive(
    "PGrass", Raster("cells", 1.0, colors=((0, "#aaffaa"), (1, "#00aa00"))), cells=Cells
)
PForce = Primitive("PForce", strength=float)
TPut = Transformation("TPut", Motion("x", "y"), x=Metres, y=Metres)
ePicture = EventType("ePicture", visual=True)
WOOD = Vocabulary.of(PFir, PSign, PWanted, PWay, PSoil, PGrass, PForce, TPut, ePicture)
BARE, SOIL = (PSoil(np.full((2, 2), value, np.int16)) for value in (0, 2))


@pytest.mark.parametrize(
    ("name", "text"),
    [("PFirTree", "fir tree"), ("PGPSMast", "gps mast"), ("eGivenUp", "given up"), ("PA1", "a 1")],
)
def test_words_of_names(name, text):
    assert words(name) == text


def test_a_primitive_without_a_meaning_has_the_words_of_its_name():
    assert legend(WOOD, {"PFirTree": {"#009e73"}}) == (LegendEntry("fir tree", Disc, ("#009e73",)),)


def test_meanings_replace_names_empty_ranges_are_left_out_and_matrices_come_last():
    plain = ((name, each.shape) for name, each in WOOD.primitives.items())
    own = {name: {shape.color} for name, shape in plain if isinstance(shape, Disc | Line | Label)}
    own |= {"PSoil": {"#000000"}, "PGrass": {"#aaffaa"}}
    assert [entry.text for entry in legend(WOOD, own)] == [
        *("fir tree", "name of a place", "wanted", "way", "grass", "stones")
    ]
    stones = legend(WOOD, {"PSoil": {"#000000"}})[0]
    assert (stones.colors, stones.opacity) == (("#000000",), 0.5)


def test_a_raster_without_meanings_has_the_shades_of_one_entry():
    (entry,) = legend(WOOD, {"PGrass": {"#00aa00"}})
    assert (entry.text, entry.colors) == ("grass", ("#aaffaa", "#00aa00"))
    shades = ((-1, ""), (0, "#000000"), (2, "#444444"), (4, "#888888"), (6, "#cccccc"))
    heat = Primitive("PHeat", Raster("cells", 1.0, colors=shades), cells=Cells)
    (scale,) = legend(Vocabulary.of(heat), {"PHeat": {"#444444"}})
    assert scale.text == "heat: 0 to 6"


def test_a_picture_explains_only_what_has_been_drawn_so_far():
    lists = Lists(WOOD)
    first = lists.picture(PFir() + BARE, {})
    second = lists.picture(PSign("gate") + BARE, {})
    third = lists.picture(SOIL, {})
    assert [entry.text for entry in first.legend] == ["fir tree"]
    assert [entry.text for entry in second.legend] == ["fir tree", "name of a place"]
    assert [entry.text for entry in third.legend] == ["fir tree", "name of a place", "stones"]


def test_populations_are_explained():
    trees = TPut(np.arange(3.0), np.zeros(3))(PFir())
    assert [entry.text for entry in Lists(WOOD).picture(trees, {}).legend] == ["fir tree"]


def test_a_disc_has_the_colour_of_a_value_and_the_legend_its_scale():
    PTree = Primitive("PTree", Disc("size", "greens( age , 0, 7)"), size=float, age=float)
    wood = Vocabulary.of(PTree, TPut)
    greens = SCALES["greens"]
    ages = [-1.0, 0.0, 3.5, 7.0, 9.0]
    shown = [greens[0], greens[0], greens[3], greens[6], greens[6]]
    nodes = [TPut(0.0, 0.0)(PTree(1.0, age)) for age in ages]
    columns = TPut(np.zeros(5), np.zeros(5))(PTree(np.ones(5), np.array(ages)))
    for scene in (Scene(tuple(node.pieces[0] for node in nodes)), columns):
        picture = Lists(wood).picture(scene, {})
        assert picture.items[0].color.tolist() == [list(rgb(color)) for color in shown]
        assert picture.legend == (LegendEntry("tree: age 0 to 7", Raster, greens),)
        page = Page(frame_of(scene, wood), 600)
        drawn = svg_document(scene, wood, page, Tracer(), "wood", "frame 0", ())
        assert re.findall(r'<circle [^>]*fill="(#\w+)"', drawn) == shown


@pytest.mark.parametrize(
    ("meaning", "texts"),
    [("well, ill", ["well", "ill"]), ("", ["person: state 3", "person: state 4"])],
)
def test_groups_have_an_entry_each(meaning, texts):
    disc = Disc(0.2, "groups(state, 3, 5)", meaning=meaning)
    PPerson = Primitive("PPerson", disc, state=int)
    people = PPerson(3) + PPerson(4)
    shown = Lists(Vocabulary.of(PPerson)).picture(people, {}).legend
    groups = zip(texts, SCALES["groups"], strict=False)
    assert shown == tuple(LegendEntry(text, Disc, (color,)) for text, color in groups)


@pytest.mark.parametrize(
    ("color", "says"),
    [
        ("greens(agee, 0, 7)", "did you mean 'age'?"),
        ("gren(age, 0, 7)", "did you mean 'greens'?"),
        ("greens(age, 7, 0)", "expected such as viridis(age, 0, 10)"),
        ("greens(age, a, b)", "expected such as viridis(age, 0, 10)"),
    ],
)
def test_a_scale_that_is_none_is_explained(color, says):
    with pytest.raises(MisuseError, match=re.escape(says)):
        legend(Vocabulary.of(Primitive("PTree", Disc(1.0, color), age=float)), {"PTree": set()})


def test_a_mark_colours_labels_and_is_no_label_itself():
    shown = Lists(WOOD).picture(PSign("gate") + TPut(9.0, 9.0)(PWanted("gate")), {})
    assert [texts.texts for texts in shown.of(Texts)] == [("gate",)]
    assert [marks.texts for marks in shown.of(Marks)] == [("gate",)]
    assert shown.marked() == {"gate": "#d55e00"}


@pytest.mark.parametrize(
    ("form", "dark"),
    [
        (Line("xs", "ys", "#ffffff"), True),
        (Line("xs", "ys", "#ff0"), True),
        (Line("xs", "ys", "#c9ccd1"), False),
        (Disc(0.3, "#ffffff"), False),
    ],
)
def test_a_line_too_pale_for_paper_has_a_dark_ground(form, dark):
    stripe = Primitive("PStripe", form, xs=tuple[float, ...], ys=tuple[float, ...])
    (entry,) = legend(Vocabulary.of(stripe), {"PStripe": {form.color}})
    assert entry.on_dark == dark


def test_pictures_over_each_other_share_a_legend_without_repetitions():
    fir = Lists(WOOD).picture(PFir(), {})
    both = combined([fir, Lists(WOOD).picture(PFir() + SOIL, {})])
    assert [entry.text for entry in both.legend] == ["fir tree", "stones"]
    assert combined([fir]) is fir
    parts = [
        Primitive(name, Disc(1.0, color, meaning="arm"))
        for name, color in (("PLink", "#111111"), ("PCup", "#222222"))
    ]
    arm = [Lists(Vocabulary.of(*parts)).picture(part(), {}) for part in parts]
    (entry,) = combined([*arm, *arm]).legend
    assert entry == LegendEntry("arm", Disc, ("#111111", "#222222"))
    assert entry.swatch is Raster
    assert combined([]).items == Picture().items


def test_meanings_survive_the_wire_and_are_absent_without_any():
    plain = plain_vocabulary(WOOD)
    shapes = {name: shape for name, _, shape in plain["primitives"]}
    assert shapes["PFirTree"] == ["disc", 0.3, "#009e73", False, 0.3]
    assert shapes["PWanted"] == ["label", "text", "#d55e00"]
    assert plain["meanings"] == {"PSign": ["name of a place"], "PSoil": ["", "nothing", "stones"]}
    assert plain["marks"] == ["PWanted"]
    assert not {"meanings", "marks"} & plain_vocabulary(Vocabulary.of(PFir, ePicture)).keys()
    back = read_vocabulary(unpack(msgpack.packb(plain)))
    shapes = {name: primitive.shape for name, primitive in back.primitives.items()}
    assert shapes == {name: primitive.shape for name, primitive in WOOD.primitives.items()}


def test_meanings_in_space_survive_the_wire_and_are_absent_without_any():
    brick = Primitive("PBrick", Disc("side", spatial=("box", "side", 0.2, 0.1)), side=float)
    at = Transformation("TAt", Motion("x", spatial=("euler", "z", 0.0, 0.0)), x=float, z=float)
    plain = plain_vocabulary(Vocabulary.of(brick, at, PFir))
    assert plain["primitives"][0][2] == ["disc", "side", "#444444", False, 0.3]
    back = read_vocabulary(unpack(msgpack.packb(plain)))
    assert back.primitives["PBrick"].shape == brick.shape
    assert back.transformations["TAt"].motion == at.motion
    assert "spatial" not in plain_vocabulary(WOOD)
