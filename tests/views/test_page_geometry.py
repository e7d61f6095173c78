"""The page draws what the other views draw: its display list is compared with theirs."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from svg_world import VOCABULARY, PBall, PHeat, PInner, PMap, PPath, PRobot, PSign, TMove, TStill

from minerva_agents.robot import world as house
from minerva_bus import Cells, Label, Metres, Primitive, Raster, Scene, Vocabulary
from minerva_bus.grammar.appearance import Disc
from minerva_bus.wire.plain import pack
from minerva_bus.wire.strings_codec import plain_scene
from minerva_bus.wire.vocabulary_codec import plain_vocabulary
from minerva_services.geometry.colors import SCALES, LegendEntry
from minerva_services.geometry.picture import Discs, Lists, Marks, Polyline, Texts, Tiles

ROOT = Path(__file__).parents[2]
STATIC = ROOT / "services" / "minerva_services" / "views" / "page" / "static"
SOURCE = ROOT / "members" / "javascript" / "src"
SCRIPT = f"""
import {{ readFileSync }} from "node:fs";
import {{ decode }} from "{SOURCE / "msgpack.js"}";
import {{ readString }} from "{SOURCE / "scene.js"}";
import {{ Vocabulary }} from "{SOURCE / "vocabulary.js"}";
import {{ colourOf, displayList, frameOf }} from "{STATIC / "geometry.js"}";
import {{ include, isPale, legend }} from "{STATIC / "legend.js"}";

const bytes = (digits) => Uint8Array.from(Buffer.from(digits, "hex"));
const {{ words, string, agent, scales }} = JSON.parse(readFileSync(0, "utf8"));
const vocabulary = new Vocabulary(decode(bytes(words)));
const nodes = readString(decode(bytes(string)), vocabulary).map((node) => ({{ ...node, agent }}));
const items = displayList(nodes, vocabulary, scales);
const drawn = new Map();
for (const item of items) include(drawn, item);
const frame = frameOf(items);
const entries = legend(drawn, vocabulary, scales)
  .map((entry) => ({{ ...entry, dark: entry.form === "line" && isPale(entry.colours[0]) }}));
console.log(JSON.stringify({{ items, frame, entries, again: frameOf([], frame) }}, (name, value) =>
  name === "matrix" ? {{ ...value, values: [...value.values] }} : value));
"""

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="needs node")

PGoal = Primitive("PGoal", Label("words", "#d55e00", marks=True), words=str)
PBird = Primitive("PBird", Disc("size", "#0000ff", heading=True), name=str, size=Metres)
WORDS = Vocabulary.of(
    *VOCABULARY.primitives.values(), *VOCABULARY.transformations.values(), PGoal, PBird
)
CELLS = np.array([[-1, 0, 1], [1, 1, 0]], np.int16)
SCENE = (
    PMap(CELLS, 0.5, 1.0, -2.0, 30.0)
    + TMove(2, 1, 90, 0.5)(PRobot() + TMove(ahead=2)(PBall(0.4) + PSign("gate")))
    + TStill()(PPath((0.0, 1.0, 2.0), (0.0, 0.5)))
    + PHeat(np.array([[0.0, 1.5]]))
    + PGoal("gate")
    + PInner()
    + TMove(x=-1)(PBird("b7", 0.2))
)


def of_the_page(scene, vocabulary=WORDS, agent="a"):
    given = {
        "words": pack(plain_vocabulary(vocabulary)).hex(),
        "string": pack(plain_scene(scene)).hex(),
        "agent": agent,
        "scales": SCALES,
    }
    done = subprocess.run(
        ["node", "--input-type=module", "-e", SCRIPT], input=json.dumps(given),
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def rows(items, form, *names):
    return [[item[name] for name in names] for item in items if item["form"] == form]


def hexadecimal(color):
    return "#" + bytes(color).hex()


def check(scene, vocabulary):
    """Compare the display list of the page with that of the windows and of the 3D page."""
    items = of_the_page(scene, vocabulary)["items"]
    picture = Lists(vocabulary).picture(scene, {})
    discs = [
        (x, y, angle, radius, bool(heading))
        for discs in picture.of(Discs)
        for x, y, angle, radius, heading in zip(
            discs.x, discs.y, discs.angle, discs.radius, discs.heading, strict=True
        )
    ]
    theirs = rows(items, "disc", "x", "y", "angle", "radius", "heading")
    assert np.array(theirs, float) == pytest.approx(np.array(discs, float), abs=1e-9)
    colors = [hexadecimal(color) for each in picture.of(Discs) for color in each.color]
    assert [color for (color,) in rows(items, "disc", "colour")] == colors
    lines = [(line.points.ravel().tolist(), line.form.color) for line in picture.of(Polyline)]
    theirs = rows(items, "line", "points", "colour", "width", "dashed")
    assert [colour for _, colour, _, _ in theirs] == [color for _, color in lines]
    for (points, *_), (expected, _) in zip(theirs, lines, strict=True):
        assert np.ravel(points) == pytest.approx(expected, abs=1e-9)
    for tiles, (x, y, angle, cell, matrix, opacity) in zip(
        picture.of(Tiles),
        rows(items, "raster", "x", "y", "angle", "cell", "matrix", "opacity"),
        strict=True,
    ):
        pose = tiles.pose
        assert (x, y, angle) == pytest.approx((pose.x, pose.y, pose.angle), abs=1e-9)
        assert (cell, opacity) == (tiles.cell, tiles.form.opacity)
        assert (matrix["rows"], matrix["columns"]) == tiles.cells.shape
        assert matrix["values"] == tiles.cells.ravel().tolist()
    texts = [
        (float(x), float(y), text, each.form.color)
        for each in picture.of(Texts)
        for x, y, text in zip(each.x, each.y, each.texts, strict=True)
    ]
    theirs = rows(items, "label", "x", "y", "text", "colour")
    assert [row[2:] for row in theirs] == [list(row[2:]) for row in texts]
    assert np.array([row[:2] for row in theirs]) == pytest.approx(
        np.array([row[:2] for row in texts])
    )
    marks = [(text, each.form.color) for each in picture.of(Marks) for text in each.texts]
    assert [tuple(row) for row in rows(items, "mark", "text", "colour")] == marks
    return items


def test_every_form_and_motion_is_drawn_alike():
    items = check(SCENE, WORDS)
    assert {item["form"] for item in items} == {"disc", "line", "raster", "label", "mark"}


def test_the_house_is_drawn_alike():
    check(house.scene({}), house.vocabulary)


def test_the_legend_has_the_same_texts():
    # Parts of one thing, in colours of their own, have one entry.
    parts = {
        name: Primitive(name, Disc(1.0, color, meaning="arm"))
        for name, color in (("PLink", "#111111"), ("PCup", "#222222"))
    }
    robot = Scene(()) + parts["PLink"]() + parts["PCup"](), Vocabulary.of(*parts.values())
    PTree, PBush = (
        Primitive(name, Disc("size", color, meaning="tree, bush"), size=float, age=int)
        for name, color in (("PTree", "greens(age, 0, 7)"), ("PBush", "groups(age, 3, 5)"))
    )
    sizes = np.ones(5), np.array([-1, 0, 3, 7, 9])
    plants = sum((PTree(*each) + PBush(*each) for each in zip(*sizes, strict=True)), Scene(()))
    wood = plants, Vocabulary.of(PTree, PBush)
    check(*wood)
    shades = ((-1, ""), *((2 * n, f"#{n}{n}{n}") for n in range(4)))
    heat = Primitive("PHeat", Raster("cells", 1.0, colors=shades), cells=Cells)
    room = Scene(()) + heat(np.arange(-1, 7).reshape(2, 4).astype(np.int16)), Vocabulary.of(heat)
    own = (SCENE, WORDS), (house.scene({}), house.vocabulary)
    for scene, vocabulary in (*own, wood, room, robot):
        page = of_the_page(scene, vocabulary)
        shown = Lists(vocabulary).picture(scene, {}).legend
        entries = [(entry.text, entry.on_dark) for entry in shown]
        assert sorted((entry["text"], entry["dark"]) for entry in page["entries"]) == sorted(
            entries
        )
    (entry,) = shown
    colors = ["#222222", "#111111"]
    assert entry == LegendEntry("arm", Disc, tuple(colors))
    assert page["entries"] == [{"text": "arm", "form": "raster", "colours": colors, "dark": False}]


def test_a_figure_of_a_population_has_the_id_that_it_shows():
    (bird,) = of_the_page(PBird("b7", 0.2), agent="~")["items"]
    assert bird["agent"] == "b7"
    (bird,) = of_the_page(PBird("b7", 0.2), agent="a")["items"]
    assert bird["agent"] == "a"


def test_the_frame_contains_everything_and_does_not_shrink():
    page = of_the_page(TMove(3, 4)(PBall(0.5)))
    frame = page["frame"]
    assert frame["left"] < 2.5
    assert frame["right"] > 3.5
    assert frame["bottom"] < 3.5
    assert frame["top"] > 4.5
    assert page["again"] == frame
    assert of_the_page(Scene(()))["frame"] == {"left": -1, "bottom": -1, "right": 1, "top": 1}
