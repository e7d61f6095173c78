"""The dashboard of a scripted world, operated by key presses."""

import asyncio
from dataclasses import replace
from io import StringIO
from math import nan

import pytest

from minerva_bus.errors import BusError
from minerva_bus.world.operator import CollectedSeries, LogEntry, LogLine, MemberStatus, WorldStatus

pytest.importorskip("textual", reason="pip install 'minerva-bus[top]'")

from rich.console import Console
from textual.widgets import DataTable, RichLog

from minerva_monitoring.top_charts import SeriesChart
from minerva_monitoring.top_dashboard import Dashboard
from minerva_monitoring.top_texts import bar, doing, phases

MEMBERS = (
    MemberStatus("steps", "present", ("generator",), "Steps", generates=("eStep",), wait=100.0),
    MemberStatus(
        "walkers",
        "late",
        ("agents",),
        kinds=("AWalker",),
        late=3,
        wait=400.0,
        figures={"source": "open", "dropped": 2},
    ),
)
STATUS = WorldStatus(
    "yard", 42, 0.1, "between frames", rate=20.0, hz=19.5, agents=7, members=MEMBERS,
    events={"eStep": 20.0, "eNoise": 3.0}, phases={"tick": 100.0, "evolve": 300.0, "frame": 1000.0},
    happenings=(LogEntry(1, 41, "eStep", "eStep<by=1>"),),
)  # fmt: skip


class Told:
    """An operator that records the calls it receives."""

    def __init__(self):
        self.now = STATUS
        self.told = []
        self.silent = False

    def status(self, since=0):
        if self.silent:
            raise BusError("the world has not answered")
        return replace(
            self.now, happenings=tuple(h for h in self.now.happenings if h.number > since)
        )

    def logs(self, since=0, member=""):
        return tuple(line for line in (LogLine(1, 0.0, "steps", "hello"),) if line.number > since)

    def __getattr__(self, name):
        return lambda *what: self.told.append((name, *what))


def run(play, operator=None, size=(130, 40)):
    operator = operator or Told()

    async def screen():
        dashboard = Dashboard(operator)
        async with dashboard.run_test(size=size) as pilot:
            await play(dashboard, pilot, operator)

    asyncio.run(screen())


async def until(pilot, holds):
    for _ in range(800):
        if holds():
            return
        await pilot.pause(0.05)
    pytest.fail("it never came")


def shown(dashboard, name):
    return str(dashboard.query_one(f"#{name}").render())


def rows(dashboard):
    table = dashboard.query_one(DataTable)
    return {key.value: [str(cell) for cell in table.get_row(key)] for key in table.rows}


def test_it_shows_members_phases_events_and_the_log():
    async def play(dashboard, pilot, operator):
        await until(pilot, lambda: len(rows(dashboard)) == 2)
        await until(pilot, lambda: "frame 42" in shown(dashboard, "heading"))
        assert "yard" in shown(dashboard, "heading")
        assert rows(dashboard)["walkers"][:4] == ["walkers", "late", "agents", "AWalker"]
        assert rows(dashboard)["walkers"][-1] == "dropped 2, source open"
        log = dashboard.query_one(RichLog)
        await until(pilot, lambda: "steps  hello" in "".join(line.text for line in log.lines))

    run(play)


def test_all_panels_fit_into_a_terminal_of_80_by_24():
    async def play(dashboard, pilot, operator):
        await until(pilot, lambda: len(rows(dashboard)) == len(operator.now.members))
        await until(pilot, lambda: "frame 42" in shown(dashboard, "heading"))
        await pilot.pause()
        assert dashboard.screen.max_scroll_y == 0
        panels = ("heading", "members", "phases", "events", "speed", "log")
        heights = {name: dashboard.query_one(f"#{name}").region.height for name in panels}
        assert heights["heading"] == 1
        assert all(height >= 4 for name, height in heights.items() if name != "heading")
        bottom = max(dashboard.query_one(f"#{name}").region.bottom for name in panels)
        assert bottom < dashboard.query_one("Footer").region.bottom == 24

    members = tuple(replace(MEMBERS[0], name=f"member-{i}") for i in range(12))
    operator = Told()
    operator.now = replace(STATUS, members=members)
    run(play, operator, size=(80, 24))


def test_numbers_remain_in_narrow_panels():
    for width in (24, 32):
        console = Console(width=width, file=StringIO())
        console.print(phases(replace(STATUS, phases={"evolve": 11_803.0, "frame": 96_506.0})))
        text = console.file.getvalue()
        assert "11,803 µs" in text
        assert "idle      84,703 µs █" in text


def test_leaving_and_joining_members_are_shown():
    async def play(dashboard, pilot, operator):
        await until(pilot, lambda: len(rows(dashboard)) == 2)
        operator.now = replace(STATUS, members=(MEMBERS[1], MemberStatus("new", "joining")))
        await until(pilot, lambda: set(rows(dashboard)) == {"walkers", "new"})

    run(play)


def test_its_keys_operate_the_world():
    async def play(dashboard, pilot, operator):
        await until(pilot, lambda: len(rows(dashboard)) == 2)
        await pilot.press("space", "s", "plus", "minus", "down", "r")
        wanted = [
            ("pause",),
            ("step",),
            ("set_rate", 30.0),
            ("set_rate", 10.0),
            ("restart", "walkers"),
        ]
        await until(pilot, lambda: len(operator.told) == len(wanted))
        assert sorted(operator.told, key=str) == sorted(wanted, key=str)
        operator.now = replace(STATUS, paused=True)
        await until(pilot, lambda: "paused" in shown(dashboard, "heading"))
        await pilot.press("space")
        await until(pilot, lambda: ("resume",) in operator.told)

    run(play)


@pytest.mark.parametrize("key", ["q", "ctrl+c"])
def test_keys_that_quit(key):
    async def play(dashboard, pilot, operator):
        await pilot.press(key)
        await until(pilot, lambda: not dashboard.is_running)

    run(play)


def test_an_unresponsive_world_is_reported_until_it_answers():
    async def play(dashboard, pilot, operator):
        operator.silent = True
        await until(pilot, lambda: "the world has not answered" in shown(dashboard, "trouble"))
        operator.silent = False
        await until(pilot, lambda: not dashboard.query_one("#trouble").display)

    run(play)


def test_a_reply_during_shutdown_is_ignored():
    async def play(dashboard, pilot, operator):
        await until(pilot, lambda: len(rows(dashboard)) == 2)
        await dashboard.query("*").remove()
        dashboard._show(STATUS, ())
        dashboard._show_trouble("too late")

    run(play)


def test_events_are_in_the_log_when_they_are_wanted():
    async def play(dashboard, pilot, operator):
        await until(pilot, lambda: len(rows(dashboard)) == 2)
        await pilot.press("e")
        operator.now = replace(STATUS, happenings=(LogEntry(2, 43, "eNoise", "eNoise<loud=9>"),))
        log = dashboard.query_one(RichLog)
        await until(pilot, lambda: "eNoise<loud=9>" in "".join(line.text for line in log.lines))

    run(play)


def test_the_members_that_a_world_waits_for():
    waiting = replace(STATUS, waiting=("walkers",), waited=2.34)
    assert doing(waiting).plain == "● waiting for walkers for 2.3 s"
    assert doing(STATUS).plain == "● running"
    assert doing(replace(STATUS, paused=True)).plain == "● paused"


@pytest.mark.parametrize(
    ("amount", "shown"), [(0, "    "), (1, "██  "), (2, "████"), (9, "████"), (0.25, "▌   ")]
)
def test_bars(amount, shown):
    assert bar(amount, 2.0, 4).plain == shown


def test_it_shows_a_chart_for_each_series():
    world = Told()
    world.now = replace(STATUS, series=2)
    world.series = lambda: (
        CollectedSeries("x", "m", (0, 1, 2), (2.0, 5.0, 9.0)),
        CollectedSeries("none", "m", (0, 1, 2), (nan, nan, nan)),
    )

    async def play(dashboard, pilot, _):
        def charts():
            return {str(each.border_title): each for each in dashboard.query(SeriesChart)}

        await until(pilot, lambda: [*charts()] == ["x", "none"])
        texts = [
            str(each.render()) for chart in charts().values() for each in chart.query("Static")
        ]
        assert texts == ["9 m", "2 to 9 m", "nothing counted", ""]

    run(play, world)
