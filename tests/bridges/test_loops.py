"""Loop closure: maps have no doubled walls, and similar corridors remain separate."""

import math
import sys
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("scipy")
from looping import Block, recorded

from minerva_agents.robot.loop_closure import Edge, closed_loops, optimised
from minerva_agents.robot.mapping import (
    MapChoice,
    doubled_walls,
    doubling_notes,
    draw_map,
    errors_of,
)
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Scan


class Tape:
    part = 0.5

    def __init__(self, readings):
        self._readings = readings

    def readings(self):
        return iter(self._readings)

    def close(self):
        pass


def silently(part):
    pass


@pytest.fixture(scope="module")
def lap():
    """The scans of just over one lap, their true poses, and their poses with drift."""
    readings = recorded(Block(24.0, 14.0))
    scans = [message.reading for message in readings if message.topic == "scan"]
    true = [
        Pose(p.x, p.y, p.angle)
        for p in (message.reading for message in readings if message.topic == "pose")
    ]
    drifted = [true[0]]
    for before, after in pairwise(true):
        east, north = after.x - before.x, after.y - before.y
        last, length = drifted[-1], math.hypot(east, north)
        off = math.radians(last.angle - before.angle)
        x = last.x + (math.cos(off) * east - math.sin(off) * north)
        y = last.y + (math.sin(off) * east + math.cos(off) * north)
        drifted.append(Pose(x, y, last.angle + after.angle - before.angle + 0.2 * length))
    return scans, true, drifted


def test_a_loop_is_closed(lap):
    scans, true, drifted = lap
    closed = closed_loops(scans, drifted, silently)
    before, after = errors_of(drifted, true), errors_of(closed.places, true)
    assert before.aligned.mean() > 2.5 * after.aligned.mean()
    end = [
        math.dist((p.x, p.y), (q.x, q.y))
        for p, q in ((drifted[-1], true[-1]), (closed.places[-1], true[-1]))
    ]
    assert (end[0] > 1.0, end[1] < 0.35, closed.closures > 2) == (True, True, True)


def test_walls_drawn_twice_are_reported(lap):
    scans, true, drifted = lap
    assert doubling_notes(scans, true, "published") == []
    (line,) = doubling_notes(scans, drifted, "odometry")
    assert "walls are drawn twice at" in line
    assert "--poses matched" in line
    assert doubling_notes(scans, closed_loops(scans, drifted, silently).places, "matched") == []


def test_a_path_that_does_not_return_has_no_loops(lap):
    scans, true, _ = lap
    closed = closed_loops(scans[:40], true[:40], silently)
    assert (closed.places, closed.closures) == (true[:40], 0)
    assert doubled_walls(scans[:40], true[:40]) == ([], 0)


def test_two_corridors_that_look_alike_are_not_one():
    """Straight walls match at many places, so no scan moves to another place."""
    places = [Pose(0.4 * number, 0.0, 0.0) for number in range(100)]
    angle = np.radians(np.arange(180) * 2.0)
    with np.errstate(divide="ignore"):
        ranges = np.abs(1.0 / np.sin(angle))
    ranges = np.where(ranges < 10.0, ranges, 0.0).astype(np.float32)
    scans = [Scan("r1", ranges, 0.0, 2.0, 10.0, 0.5 * number) for number in range(100)]
    closed = closed_loops(scans, places, silently)
    assert max(abs(p.x - q.x) for p, q in zip(closed.places, places, strict=True)) < 1.0


def test_a_closure_that_contradicts_the_others_is_turned_off():
    poses = np.array([(float(x), 0.0, 0.0) for x in range(20)])
    exact = np.diag([1e4, 1e4, 1e4])
    steps = [Edge(k, k + 1, np.array([1.0, 0.0, 0.0]), exact) for k in range(19)]
    good = [Edge(0, k, np.array([float(k), 0.0, 0.0]), exact, closes=True) for k in (10, 15, 19)]
    wrong = Edge(2, 17, np.zeros(3), exact, closes=True)
    after, counts = optimised(poses, [*steps, *good, wrong])
    assert counts[-1] < 0.01 < 0.9 < counts[19:-1].min()
    assert np.abs(after - poses).max() < 0.05


def test_a_map_reports_closed_loops_and_has_single_walls():
    readings = recorded(Block(16.0, 12.0))
    parts = []
    made = draw_map(lambda: Tape(readings), MapChoice(cell=0.1, poses="matched"), parts.append)
    assert any(note.startswith("loops: ") for note in made.notes)
    assert not any("drawn twice" in note for note in made.notes)
    assert made.drift is not None
    assert made.drift.taken.aligned.mean() < 0.15
    # The first scans do not turn all others: 0.09 m if they do.
    assert made.drift.taken.metres.mean() < 0.06
    assert parts == sorted(parts)


def test_missing_scipy_names_the_extra(monkeypatch):
    monkeypatch.delitem(sys.modules, "minerva_agents.robot.loop_closure", raising=False)
    monkeypatch.setitem(sys.modules, "scipy", None)
    readings = recorded(Block(8.0, 8.0), laps=0.2)
    made = draw_map(lambda: Tape(readings), MapChoice(cell=0.1, poses="matched"), silently)
    assert "pip install 'minerva-bus[maps]'" in made.notes[0]
