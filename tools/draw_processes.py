"""Drawings of docs/concepts about processes: frames, phases, layouts, columns and crashes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from minerva_bus.frame.world_state import TRANSITIONS, Awaited, Phase
from tools.svg_sheet import AGENT, EVENT, FAINT, INK, PRIMITIVE, TRANSFORMATION, Sheet

EVENTS, WORK, VIEWS, IDLE, LOST = "#ead5f1", "#fbdcc4", "#cfe3f2", "#f3f5f8", "#f6caca"


def lanes(sheet: Sheet, names: Mapping[str, float], right: float) -> None:
    """A dashed line for each participant."""
    for name, y in names.items():
        sheet.text(24, y + 4.5, name, "bold")
        sheet.line([(130, y), (right, y)], "#d5d9e0", "4 4")


def bar(sheet: Sheet, x: float, end: float, y: float, label: str, fill: str) -> None:
    """Work of a participant from x to end."""
    sheet.box(x, y - 13, end - x, 26, label, fill)


def frame() -> Sheet:
    """One frame as a timeline: two round trips, and who waits for whom."""
    sheet = Sheet("One frame on the bus, from its tick to the views", 800, 372)
    generators, coordinator, host, other_host, device = 66, 136, 206, 266, 326
    names = {"generators": 66, "coordinator": 136, "host 1": 206, "host 2": 266, "devices": 326}
    lanes(sheet, names, 776)
    for x, end, label in ((150, 320, "TICK"), (320, 620, "EVOLVE"), (620, 680, "READY")):
        sheet.line([(x, 30), (x, 346)], "#e3e6eb")
        sheet.text((x + end) / 2, 24, label, "small", "middle")
    sheet.line([(680, 30), (680, 346)], "#e3e6eb")
    sheet.text(728, 24, "TICK", "small", "middle")
    bar(sheet, 180, 262, generators, "measure", EVENTS)
    bar(sheet, 150, 172, coordinator, "", IDLE)
    bar(sheet, 284, 340, coordinator, "collect", EVENTS)
    bar(sheet, 366, 470, host, "evolve, view", WORK)
    bar(sheet, 366, 530, other_host, "evolve, view", WORK)
    bar(sheet, 534, 614, coordinator, "commit", WORK)
    bar(sheet, 640, 760, device, "draw, move", VIEWS)
    bar(sheet, 680, 702, coordinator, "", IDLE)
    sheet.arrow([(162, coordinator - 13), (182, generators + 13)], EVENT)
    sheet.text(150, 104, "tick t", anchor="middle", color=EVENT)
    sheet.arrow([(258, generators + 13), (288, coordinator - 13)], EVENT)
    sheet.text(284, 104, "events", color=EVENT)
    sheet.arrow([(338, coordinator + 13), (368, host - 13)], AGENT)
    sheet.line([(338, coordinator + 13), (354, 200)], AGENT)
    sheet.arrow([(354, 200), (368, other_host - 13)], AGENT)
    sheet.text(332, 182, "events", anchor="end", color=AGENT)
    sheet.arrow([(466, host - 13), (534, coordinator + 4)], AGENT)
    sheet.arrow([(526, other_host - 13), (552, coordinator + 13)], AGENT)
    sheet.text(480, 150, "changes, views,", anchor="end", color=AGENT)
    sheet.text(480, 167, "new events", anchor="end", color=AGENT)
    sheet.arrow([(608, coordinator + 13), (644, device - 13)], TRANSFORMATION)
    sheet.text(638, 240, "views of frame t", color=TRANSFORMATION)
    sheet.arrow([(692, coordinator - 13), (716, generators + 13)], EVENT)
    sheet.text(720, 104, "tick t + 1", color=EVENT)
    return sheet


PLACES: Final = {
    Phase.WAITING: (24, 30), Phase.READY: (236, 30), Phase.TICK: (448, 30),
    Phase.EVOLVE: (640, 30), Phase.CLOSING: (640, 170), Phase.STOPPING: (448, 170),
    Phase.ENDED: (236, 170),
}  # fmt: skip
MEANING: Final = {
    Phase.WAITING: "members join", Phase.READY: "between frames", Phase.TICK: "generators reply",
    Phase.EVOLVE: "hosts reply", Phase.CLOSING: "last view", Phase.STOPPING: "members report",
    Phase.ENDED: "",
}  # fmt: skip


def phases() -> Sheet:
    """The table of phases; the transitions of `End`, possible in each phase, are one line."""
    sheet = Sheet("The phases of a world", 800, 262)
    for phase, (x, y) in PLACES.items():
        label = f"{phase.name}\n{MEANING[phase]}".strip()
        fill = {Phase.TICK: EVENTS, Phase.EVOLVE: WORK, Phase.CLOSING: VIEWS}.get(phase, IDLE)
        sheet.box(x, y, 136, 50, label, fill)
    for (before, why), after in TRANSITIONS.items():
        (x, y), (end_x, end_y) = PLACES[before], PLACES[after]
        if why is Awaited.END or (before in (Phase.WAITING, Phase.READY) and why is Awaited.OVER):
            continue
        if (before, after) == (Phase.EVOLVE, Phase.READY):
            sheet.arrow([(690, 80), (690, 112), (304, 112), (304, 80)])
            sheet.text(500, 106, "hosts answered: next frame", "small", "middle")
        elif y != end_y:
            sheet.arrow([(740, 80), (740, 170)])
            sheet.text(732, 150, "world over", "small", "end")
        else:
            right = end_x > x
            sheet.arrow(
                [(x + 136, y + 25), (end_x, y + 25)]
                if right
                else [(x, y + 25), (end_x + 136, y + 25)]
            )
    sheet.text(24, 176, "From every phase, Ctrl-C", "small")
    sheet.text(24, 193, "or a failure leads to", "small")
    sheet.text(24, 210, "STOPPING.", "small")
    return sheet


def layouts() -> Sheet:
    """The same world in one process, in four, and on two machines."""
    sheet = Sheet("The same world in three layouts", 800, 286)
    sheet.text(24, 34, "one process", "bold")
    sheet.box(24, 50, 170, 128, fill="#fafbfc", edge=FAINT)
    for row, (label, fill) in enumerate(
        (("coordinator", IDLE), ("agents", WORK), ("sensors", EVENTS), ("views", VIEWS))
    ):
        sheet.box(40, 60 + 28 * row, 138, 24, label, fill)
    sheet.text(234, 34, "many processes", "bold")
    sheet.box(300, 50, 110, 30, "coordinator", IDLE)
    for column, (label, fill) in enumerate(
        (("agents 1", WORK), ("agents 2", WORK), ("sensors", EVENTS), ("views", VIEWS))
    ):
        x = 224 + 68 * column
        sheet.line([(355, 80), (x + 31, 148)])
        sheet.box(x, 148, 62, 30, label, fill)
    sheet.text(534, 34, "two machines, one process killed", "bold")
    sheet.box(524, 50, 122, 128, fill="#fafbfc", edge=FAINT)
    sheet.box(664, 50, 112, 128, fill="#fafbfc", edge=FAINT)
    sheet.box(532, 60, 106, 30, "coordinator", IDLE)
    sheet.line([(638, 75), (672, 75)])
    sheet.line([(585, 90), (585, 132)])
    sheet.line([(638, 82), (672, 140)])
    sheet.box(532, 132, 106, 30, "sensors", EVENTS)
    sheet.box(672, 60, 96, 30, "agents 1", LOST)
    sheet.line([(672, 60), (768, 90)], "#b3261e")
    sheet.line([(672, 90), (768, 60)], "#b3261e")
    sheet.box(672, 126, 96, 30, "agents 2", WORK)
    for x in (109, 355, 650):
        sheet.arrow([(x, 188), (x, 222)], INK)
    sheet.box(
        24,
        224,
        752,
        40,
        "the same string, and the same digest, in every frame",
        "#eaf4ec",
        PRIMITIVE,
        "bold",
    )
    return sheet


def columns() -> Sheet:
    """Five agents as nodes, and as columns."""
    sheet = Sheet("Agents as nodes and as columns of one population", 800, 268)
    sheet.text(24, 34, "five nodes: an object for each agent", "bold")
    rows = [
        ("a", "0.5", "5.0"),
        ("b", "2.0", "3.1"),
        ("c", "2.4", "0.2"),
        ("d", "7.1", "8.8"),
        ("e", "9.9", "4.0"),
    ]
    for row, (name, x, energy) in enumerate(rows):
        y = 54 + 36 * row
        sheet.box(24, y, 260, 28, f"ASheep#{name}<x={x}, energy={energy}>", WORK, kind="mono")
    sheet.text(430, 34, "one population: an array for each attribute", "bold")
    for column, label in enumerate(("id", "x", "energy")):
        x = 430 + 84 * column
        sheet.text(x + 36, 62, label, "mono", "middle", AGENT)
        for row, values in enumerate(rows):
            sheet.box(
                x,
                72 + 27 * row,
                72,
                27,
                values[column],
                WORK if column == 0 else EVENTS,
                kind="mono",
            )
    sheet.arrow([(300, 140), (412, 140)], INK)
    sheet.arrow([(412, 152), (300, 152)], INK)
    sheet.text(356, 130, "the same string", "small", "middle")
    sheet.text(356, 174, "the same digest", "small", "middle")
    sheet.text(690, 100, "slices of rows", "small")
    for y, height, host in ((72, 81, "host 1"), (153, 54, "host 2")):
        sheet.line([(670, y + 3), (677, y + 3), (677, y + height - 3), (670, y + height - 3)])
        sheet.text(690, y + height / 2 + (10 if host == "host 1" else 5), host)
    sheet.text(24, 252, "λ of one agent: self.energy -= 1", "mono small")
    sheet.text(430, 236, "λ of the population: self.energy -= 1", "mono small")
    return sheet


def succession() -> Sheet:
    """A coordinator is killed in frame 41, and its successor repeats that frame."""
    sheet = Sheet("A coordinator is killed, and a successor continues from the journal", 800, 300)
    old, journal, new, host = 60, 130, 200, 264
    lanes(sheet, {"coordinator": old, "journal": journal, "successor": new, "members": host}, 776)
    bar(sheet, 150, 250, old, "frame 40", WORK)
    bar(sheet, 256, 330, old, "frame 41", WORK)
    sheet.line([(322, 46), (342, 74)], "#b3261e")
    sheet.line([(322, 74), (342, 46)], "#b3261e")
    sheet.text(350, 44, "killed: the launcher starts a successor", color="#b3261e")
    bar(sheet, 142, 218, journal, "key frame", IDLE)
    for x, number in ((224, 39), (264, 40)):
        bar(sheet, x, x + 34, journal, str(number), IDLE)
    sheet.arrow([(244, old + 13), (270, journal - 13)])
    sheet.arrow([(296, journal + 8), (430, new - 13)])
    sheet.text(382, 154, "string, and the inputs since then", "small")
    bar(sheet, 412, 520, new, "repeats 39, 40", IDLE)
    bar(sheet, 526, 626, new, "frame 41", WORK)
    bar(sheet, 632, 732, new, "frame 42", WORK)
    bar(sheet, 150, 330, host, "connected", VIEWS)
    bar(sheet, 336, 518, host, "keep state, reconnect", IDLE)
    bar(sheet, 526, 732, host, "connected", VIEWS)
    return sheet


PROCESSES: Final[Mapping[str, Callable[[], Sheet]]] = {
    "frame": frame,
    "phases": phases,
    "layouts": layouts,
    "columns": columns,
    "succession": succession,
}
