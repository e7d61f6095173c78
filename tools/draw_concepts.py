"""Illustrations of docs/concepts: run `python -m tools.draw_concepts --write`.

Without `--write` it compares the files with what it would write; exit code 1 if they differ.
Strings in the drawings are those of the Python blocks of the pages beside them.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from minerva_bus import Scene, Vocabulary, visualize
from minerva_bus.grammar.scene import EMPTY, FigureNode, Node, rescoped
from minerva_services.geometry.picture import Discs, Lists
from tools.draw_processes import PROCESSES
from tools.svg_sheet import AGENT, EVENT, FAINT, PRIMITIVE, TRANSFORMATION, Sheet

FOLDER: Final = Path(__file__).parents[1] / "docs" / "concepts"
BLOCK: Final = re.compile(r"^```python\n(.*?)^```", re.S | re.M)
SYMBOL: Final = re.compile(r"([PTA][A-Za-z]+(?:#[\w:]+)?)")
COLORS: Final = {"P": PRIMITIVE, "T": TRANSFORMATION, "A": AGENT}


def names_of(page: str) -> dict[str, Any]:
    """The names that the Python blocks of a page define."""
    names: dict[str, Any] = {"__name__": "page"}
    for block in BLOCK.findall((FOLDER / page).read_text(encoding="utf-8")):
        # `annotations` of this module must not apply to the blocks.
        exec(compile(block, page, "exec", dont_inherit=True), names)
    return names


def colored(text: str) -> list[tuple[str, str]]:
    """A string as pairs of text and colour: symbols in the colours of their kind."""
    return [
        (part, COLORS[part[0]] if SYMBOL.fullmatch(part) else FAINT)
        for part in SYMBOL.split(text)
        if part
    ]


def own_text(node: Node) -> str:
    """A node without its scope."""
    bare = node if isinstance(node, FigureNode) else rescoped(node, EMPTY)
    return str(Scene((bare,))).removesuffix("()")


def tree(sheet: Sheet, scene: Scene, x: float, y: float) -> float:
    """Draw the nodes of a string as an indented tree; returns the y below it."""
    for node in scene.nodes:
        sheet.text(x + 14, y + 4, colored(own_text(node)), "mono")
        sheet.disc(x, y, 4, COLORS[node.symbol[0]])
        below = y + 30
        if not isinstance(node, FigureNode) and node.scope:
            for inner in node.scope.nodes:
                sheet.line([(x, y + 5), (x, below), (x + 20, below)])
                below = tree(sheet, Scene((inner,)), x + 26, below)
        y = below
    return y


def plane(sheet: Sheet, view: Scene, vocabulary: Vocabulary, x: float, y: float) -> None:
    """Draw a view in a panel of 4.6 m x 2.3 m whose upper left corner is at (x, y)."""
    scale = 50
    sheet.box(x, y, 4.6 * scale, 2.3 * scale, fill="#fbfbf7")
    for metre in range(5):
        at = x + (0.3 + metre) * scale
        sheet.line([(at, y + 1.6 * scale), (at, y + 1.8 * scale)])
        sheet.text(at, y + 2.14 * scale, f"{metre} m", "small", "middle")
    sheet.line([(x + 4, y + 1.6 * scale), (x + 4.52 * scale, y + 1.6 * scale)])
    for discs in Lists(vocabulary).picture(view, {}).of(Discs):
        rows = zip(discs.x, discs.y, discs.radius, discs.color, strict=True)
        for right, up, radius, (red, green, blue) in rows:
            at = x + (0.3 + right) * scale, y + (1.6 - up) * scale
            sheet.disc(*at, radius * scale, f"#{red:02x}{green:02x}{blue:02x}")


def string() -> Sheet:
    """The string of the first page, its tree, its view, and the picture of the view."""
    names = names_of("1-strings.md")
    sheet = Sheet("A string, its tree, and its picture", 800, 330)
    sheet.text(24, 34, "the string w", "bold")
    sheet.text(24, 60, colored(str(names["w"])), "mono")
    sheet.text(24, 108, "as a tree", "bold")
    tree(sheet, names["w"], 34, 136)
    sheet.text(24, 272, "its view π(w): primitives and transformations", "bold")
    sheet.text(24, 298, colored(str(names["picture"])), "mono")
    sheet.text(545, 108, "the view in a plane: φ(π(w))", "bold")
    plane(sheet, names["picture"], names["vocabulary"], 545, 122)
    for left, label, color in (
        (0, "primitive", PRIMITIVE),
        (100, "transformation", TRANSFORMATION),
        (240, "agent", AGENT),
    ):
        sheet.disc(470 + left, 29, 5, color)
        sheet.text(482 + left, 34, label, color=color)
    return sheet


def evolution() -> Sheet:
    """The three strings of the second page, with the events between them."""
    first, second = names_of("1-strings.md"), names_of("2-events.md")
    snail, visual = first["Snail"], first["ePicture"]
    sheet = Sheet("Rain changes the agents of a string and leaves the rest as it is", 800, 490)
    events = ["eRain<amount=0.5>", "eRain<amount=1>"]
    for frame, name in enumerate(["w", "after_one", "after_two"]):
        y = 24 + 150 * frame
        scene = first["vocabulary"].read(re.sub(r", births=\d+", "", str(second[name])))
        view = visualize(scene, [visual()], [snail])
        sheet.text(24, y + 16, f"w{'₀₁₂'[frame]}", "bold")
        tree(sheet, scene, 74, y + 12)
        plane(sheet, view, first["vocabulary"], 550, y)
        if frame < len(events):
            sheet.arrow([(38, y + 26), (38, y + 148)], EVENT)
            sheet.text(50, y + 132, [("η: ", EVENT), (events[frame], EVENT)], "mono")
    return sheet


def algorithm() -> Sheet:
    """Table 2 as a loop."""
    sheet = Sheet("The steps of Table 2 as a loop", 800, 300)
    light = {"E": "#f6ecf9", "A": "#fdf1e8", "V": "#e9f2f9", "N": "#f3f5f8"}
    boxes = {
        "1  begin\nw = w₀, t = 0": (24, 110, 110, "N"),
        "2  collect the events\ne* = E(G*, t)": (174, 110, 160, "E"),
        "3, 4  separate them\ne* = eᵛ + eᵘ": (374, 110, 150, "E"),
        "5  evolve\nw_next = η(w, eᵘ)": (584, 30, 170, "A"),
        "6  make views\nv = π(w, eᵛ)": (584, 110, 170, "V"),
        "7  show them\ng = φ(v)": (584, 190, 170, "V"),
        "8  next frame\nw = w_next, t = t + 1": (374, 220, 170, "N"),
        "9, 10  is w = ε?": (194, 220, 120, "N"),
        "11  end": (24, 220, 90, "N"),
    }
    for label, (x, y, width, kind) in boxes.items():
        sheet.box(x, y, width, 54, label, light[kind])
    sheet.arrow([(134, 137), (174, 137)])
    sheet.arrow([(334, 137), (374, 137)])
    sheet.arrow([(524, 137), (554, 137), (554, 57), (584, 57)])
    sheet.arrow([(554, 137), (584, 137)])
    sheet.arrow([(669, 164), (669, 190)])
    sheet.arrow([(754, 57), (778, 57), (778, 262), (544, 262)])
    sheet.line([(584, 217), (566, 217), (566, 262)])
    sheet.arrow([(374, 247), (314, 247)])
    sheet.arrow([(194, 247), (114, 247)])
    sheet.text(154, 240, "yes", "small", "middle")
    sheet.arrow([(254, 220), (254, 164)])
    sheet.text(262, 196, "no", "small")
    sheet.text(24, 40, "Steps 5 and 6 read the same w, that of the", "small")
    sheet.text(24, 57, "beginning of the frame, and may run in parallel.", "small")
    return sheet


DRAWINGS: Final[Mapping[str, Callable[[], Sheet]]] = {
    "string": string,
    "evolution": evolution,
    "algorithm": algorithm,
    **PROCESSES,
}


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="write the files")
    write: bool = parser.parse_args().write
    stale: list[str] = []
    for name, drawing in DRAWINGS.items():
        path, text = FOLDER / f"{name}.svg", drawing().document()
        if write:
            path.write_text(text, encoding="utf-8")
        elif not path.exists() or path.read_text(encoding="utf-8") != text:
            stale.append(path.name)
    if stale:
        print(f"not up to date: {', '.join(stale)}; run python -m tools.draw_concepts --write")
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
