"""docs/timeouts.md: its tables match the code's constants, and its two claims hold."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from minerva_bus.launch import process_table, supervisor
from minerva_bus.runtime import coordinator, joining, participants, session, timeouts

PAGE = Path(__file__).parents[2] / "docs" / "timeouts.md"
ROW = re.compile(r"^\| `((?:runtime|launch|process_life)\.[\w.]+)` \| ([\d.]+) \| .+ \|$", re.M)


def constant(path):
    modules = 1 if path.startswith("process_life") else 2
    package, names = path.split(".")[:modules], path.split(".")[modules:]
    value = import_module(".".join(["minerva_bus", *package]))
    for name in names:
        value = getattr(value() if isinstance(value, type) else value, name)
        value = value() if isinstance(value, type) else value
    return value


def test_the_page_has_rows():
    assert len(ROW.findall(PAGE.read_text())) == PAGE.read_text().count("\n| `") >= 20


@pytest.mark.parametrize(("path", "seconds"), ROW.findall(PAGE.read_text()))
def test_a_row_is_as_in_the_code(path, seconds):
    assert constant(path) == float(seconds)


def test_numbers_in_words_are_as_in_the_code():
    text = PAGE.read_text()
    assert (process_table.STARTS_PER_CORE, "four at once on each core" in text) == (4, True)
    assert (timeouts.TIMES_SLOWEST, "ten times the slowest start" in text) == (10.0, True)
    assert (process_table.HEALTHY_FRAMES, "10 frames (`HEALTHY_FRAMES`)" in text) == (10, True)


def test_timeouts_that_follow_one_another_are_in_order():
    patience, arrival = timeouts.Patience(), joining.Arrival()
    assert patience.soft < patience.hard
    assert process_table.SLOT_SECONDS < timeouts.START
    assert coordinator.GREETED_AGAIN < arrival.greeted < arrival.greeted_at_most
    assert session.LEASE < participants.BACK_WITHIN < coordinator.BACK_WITHIN
    assert session.LEASE + participants.BACK_WITHIN < supervisor.STOPPED_SECONDS
    assert session.LEASE < joining.NAME_FREE_AGAIN < participants.BACK_WITHIN
    assert coordinator.HURRIED_REPORTS_WITHIN < supervisor.STOP_SECONDS
    assert process_table.MAX_RESTART_SECONDS < process_table.HEALTHY_SECONDS
