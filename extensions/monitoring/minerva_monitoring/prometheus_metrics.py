"""Metrics of a world for Prometheus, from its status and its totals.

Every name begins with `minerva_` and has the label `world`; docs/fleet.md has the table. Needs the
extra `metrics`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import accumulate
from typing import Any

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from minerva_bus.runtime.metrics import BOUNDS, Durations, Totals
from minerva_bus.world.operator import MemberStatus, WorldStatus

_UP = "1 while the coordinator answers."

Samples = Iterable[tuple[tuple[str, ...], float]]
"""Values of labels, without that of `world`, with the value of the metric."""


def world_metrics(status: WorldStatus, totals: Totals) -> Iterator[Metric]:
    """All metrics of a world that answers."""
    yield from _frames(status)
    yield from _totals(status.world, totals)
    yield from _members(status)


def down_metrics(world: str) -> Iterator[Metric]:
    """The metrics of a world that does not answer."""
    yield _gauge(world, "up", _UP, 0)


def _family(
    cls: type[Any], world: str, name: str, help: str, samples: Samples, labels: tuple[str, ...] = ()
) -> Metric:
    family = cls(f"minerva_{name}", help, labels=["world", *labels])
    for values, value in samples:
        family.add_metric([world, *values], value)
    return family


def _gauge(world: str, name: str, help: str, value: float) -> Metric:
    return _family(GaugeMetricFamily, world, name, help, [((), value)])


def _counter(world: str, name: str, help: str, samples: Samples, *labels: str) -> Metric:
    return _family(CounterMetricFamily, world, name, help, samples, labels)


def _frames(status: WorldStatus) -> Iterator[Metric]:
    waiting = len(status.waiting) if status.waited else 0
    for name, help, value in (
        ("up", _UP, 1),
        ("frame", "The current or next frame.", status.frame),
        ("frame_rate_hertz", "Measured frames per second.", status.hz),
        ("frame_rate_wanted_hertz", "Requested frames per second; 0: no limit.", status.rate),
        ("simulated_seconds", "Simulated time since the world began.", status.time),
        ("paused", "1 while the world is paused.", status.paused),
        ("agents", "Agents in the string.", status.agents),
        ("waiting_seconds", "How long the frame has waited for members.", status.waited),
        ("waiting_members", "Members that the frame waits for.", waiting),
    ):
        yield _gauge(status.world, name, help, value)
    for name, help, value in (
        ("late_frames", "Frames that took longer than real time.", status.late_frames),
        ("behind_seconds", "Time by which late frames were late.", status.behind),
    ):
        yield _counter(status.world, name, help, [((), value)])


def _totals(world: str, totals: Totals) -> Iterator[Metric]:
    phases = HistogramMetricFamily(
        "minerva_frame_phase_seconds", "Parts of a frame; `frame`: all of it, with waiting.",
        labels=["world", "phase"],
    )  # fmt: skip
    for name, durations in totals.phases.items():
        phases.add_metric([world, name], _buckets(durations), durations.seconds)
    yield phases
    events = [((name,), count) for name, count in totals.events.items()]
    yield _counter(world, "events", "Events by type.", events, "type")
    sizes = [(("in",), totals.bytes_in), (("out",), totals.bytes_out)]
    yield _counter(world, "bytes", "Bytes from (in) and to (out) members.", sizes, "direction")


def _buckets(durations: Durations) -> list[tuple[str, float]]:
    # Buckets of Prometheus are cumulative.
    bounds = [*map(str, BOUNDS), "+Inf"]
    return list(zip(bounds, accumulate(durations.counts), strict=True))


def _members(status: WorldStatus) -> Iterator[Metric]:
    world, members = status.world, status.members
    # A member has no role before its hello.
    counts = Counter((role, m.state) for m in members for role in m.roles or ("none",))
    text = "Members by role and state."
    roles = sorted(counts.items())
    yield _family(GaugeMetricFamily, world, "members", text, roles, ("role", "state"))
    text = "Mean time that a frame waits for a member's answers."
    waits = [((m.name,), m.wait / 1e6) for m in members]  # The status has µs.
    yield _family(GaugeMetricFamily, world, "member_wait_seconds", text, waits, ("member",))
    refused = [((who,), count) for who, count in sorted(status.refused.items())]
    yield _counter(world, "refused", "Refused messages and connections.", refused, "who")
    for name, text, samples in (
        ("late_answers", "Answers that arrived too late.", [((m.name,), m.late) for m in members]),
        ("dropped_events", "Events dropped from a full queue.", [_dropped(m) for m in members]),
        ("restarts", "Times that a member has joined again.", [_restarts(m) for m in members]),
    ):
        yield _counter(world, name, text, samples, "member")


def _dropped(member: MemberStatus) -> tuple[tuple[str], float]:
    dropped = member.figures.get("dropped", 0)
    return (member.name,), dropped if isinstance(dropped, int | float) else 0


def _restarts(member: MemberStatus) -> tuple[tuple[str], float]:
    return (member.name,), max(0, member.joins - 1)
