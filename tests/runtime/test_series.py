"""Collected series of a running world: bounded, evenly spaced, and shown by monitors and the page."""

import math

import numpy as np
import pytest

from minerva_bus import Agent, EventType, World, count, each, on, run
from minerva_bus.collect.collector import MAX_POINTS, MAX_SERIES, SeriesHistory
from minerva_bus.collect.plans import plans_of, read_entries
from minerva_bus.errors import ProtocolError
from minerva_bus.grammar.types import Metres
from minerva_bus.wire.plain import pack
from minerva_bus.wire.status_codec import plain_series, read_series
from minerva_bus.world.operator import CollectedSeries

eTick = EventType("eTick")


class Hare(Agent, symbol="AHare"):
    x: Metres = 0.0

    @on("eTick")
    def run(self, tick, moment):
        self.x += 1.0


def field(**settings):
    return World("AHare#a · AHare#b<x=4>", agents=[Hare], services=[each(eTick)], **settings)


COLLECT = {"hares": count(Hare), "x": Hare.x.mean(), "none": Hare.x.mean("x < 0"),
           "bins": Hare.x.histogram(0, 100, 5), "rows": Hare.x, "late": Hare.x.max().every(3)}  # fmt: skip


def history(collect=COLLECT):
    vocabulary = field().vocabulary
    plans = plans_of(read_entries(collect), vocabulary)
    return SeriesHistory(plans, vocabulary), plans


@pytest.mark.parametrize(
    "frames", [0, 1, 5, MAX_POINTS - 1, MAX_POINTS, MAX_POINTS + 1, 1000, 5000]
)
def test_a_series_is_bounded_and_spans_the_run(frames):
    kept, plans = history({"x": Hare.x.mean()})
    for frame in range(frames):
        kept.add(plans[0].name, {"frame": frame, "x": 0.5 * frame})
    (series,) = kept.series()
    assert len(series.frames) <= MAX_POINTS
    assert series.values == tuple(0.5 * frame for frame in series.frames)
    assert series.unit == "m"
    if frames:
        assert (series.frames[0], series.frames[-1]) == (0, frames - 1)
        assert len(series.frames) >= min(frames, MAX_POINTS // 2)
        steps = set(np.diff(series.frames[:-1]).tolist())
        assert len(steps) <= 1


def test_only_numbers_of_frames_are_series_and_the_first_ones_only():
    kept, _ = history()
    assert [each.name for each in kept.series()] == ["hares", "x", "none", "late"]
    assert len(kept) == 4
    wide, plans = history({f"x{n}": Hare.x.mean() for n in range(MAX_SERIES + 5)})
    assert len(wide) == MAX_SERIES
    row = {"frame": 10**9} | {f"x{n}": 1e300 for n in range(MAX_SERIES + 5)}
    for _ in range(2 * MAX_POINTS):
        wide.add(plans[0].name, row)
    assert len(pack({"series": plain_series(wide.series())})) < 100_000


def test_series_are_the_same_after_the_bus():
    series = (CollectedSeries("x", "m", (0, 3, 6), (1.0, math.nan, -2.5)), CollectedSeries("n"))
    assert repr(read_series(plain_series(series))) == repr(series)
    for wrong in (
        [{"name": "x", "frames": [1], "values": []}],
        [{"name": "x", "frames": [1], "values": ["a"]}],
        [{"frames": []}], [3], {},
    ):  # fmt: skip
        with pytest.raises(ProtocolError):
            read_series(wrong)


def test_a_running_world_answers_with_its_series_and_gives_the_same_string(tmp_path):
    into = tmp_path / "out.csv"
    plain = run(field(), frames=40, seed=1)
    with field(collect=COLLECT).start(seed=1, bus=True, into=into) as live:
        live.step(40)
        assert live.operator.status().series == 4
        series = {each.name: each for each in live.operator.series()}
        assert live.digest == plain.digest
    assert series["hares"].frames == tuple(range(40))
    assert series["x"].values == tuple(2.0 + n for n in range(40))
    assert all(map(math.isnan, series["none"].values))
    assert series["late"].frames == tuple(range(0, 40, 3))


def test_a_world_that_collects_nothing_has_no_series():
    with field().start(seed=1) as live:
        live.step(2)
        assert live.operator.status().series == 0
        assert live.operator.series() == ()
