"""A world's figures for Prometheus, from its status and its totals.

Every name begins with `minerva_` and has the label `world`; docs/fleet.md has the table. Needs the
extra `metrics`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from minerva_bus.runtime.totals import BOUNDS, Durations, Totals
from minerva_bus.world.operator import MemberStatus, WorldStatus

_MICRO = 1e-6


def figures(status: WorldStatus, totals: Totals) -> Iterator[Metric]:
    """All metric families of a world that answers."""
    yield _gauge("up", "1 while the coordinator answers.", status, 1)
    yield from _frames(status)
    yield from _counted(status.world, totals)
    yield from _members(status)


def no_figures(world: str) -> Iterator[Metric]:
    """What there is to say of a world that does not answer."""
    up = GaugeMetricFamily("minerva_up", "1 while the coordinator answers.", labels=["world"])
    up.add_metric([world], 0)
    yield up


def _gauge(name: str, words: str, status: WorldStatus, value: float) -> Metric:
    family = GaugeMetricFamily(f"minerva_{name}", words, labels=["world"])
    family.add_metric([status.world], value)
    return family


def _frames(status: WorldStatus) -> Iterator[Metric]:
    yield _gauge("frame", "The frame that runs or comes next.", status, status.frame)
    yield _gauge("frame_rate_hertz", "Frames per second, as reached.", status, status.hz)
    yield _gauge(
        "frame_rate_wanted_hertz", "Frames per second that are wanted; 0: as many as go.",
        status, status.rate,
    )  # fmt: skip
    yield _gauge("simulated_seconds", "Simulated time since the world began.", status, status.time)
    yield from _late(status)
    yield _gauge("paused", "1 while no frame may begin.", status, status.paused)
    yield _gauge("agents", "Agents in the string.", status, status.agents)
    yield _gauge(
        "waiting_seconds", "For how long the frame has waited for members.", status, status.waited
    )
    yield _gauge(
        "waiting_members",
        "For how many members the frame has waited.",
        status,
        len(status.waiting) if status.waited else 0,
    )


def _late(status: WorldStatus) -> Iterator[Metric]:
    words = "Frames that took longer than real time."
    frames = CounterMetricFamily("minerva_late_frames", words, labels=["world"])
    frames.add_metric([status.world], status.late_frames)
    yield frames
    words = "Seconds by which they took longer."
    behind = CounterMetricFamily("minerva_behind_seconds", words, labels=["world"])
    behind.add_metric([status.world], status.behind)
    yield behind


def _counted(world: str, totals: Totals) -> Iterator[Metric]:
    phases = HistogramMetricFamily(
        "minerva_frame_phase_seconds", "Parts of a frame; `frame` is all of it, waiting included.",
        labels=["world", "phase"],
    )  # fmt: skip
    for name, durations in totals.phases.items():
        phases.add_metric([world, name], _buckets(durations), durations.seconds)
    yield phases
    events = CounterMetricFamily("minerva_events", "Events by type.", labels=["world", "type"])
    for name, count in totals.events.items():
        events.add_metric([world, name], count)
    yield events
    size = CounterMetricFamily(
        "minerva_bytes", "Bytes from (in) and to (out) members.", labels=["world", "direction"]
    )
    size.add_metric([world, "in"], totals.bytes_in)
    size.add_metric([world, "out"], totals.bytes_out)
    yield size


def _buckets(durations: Durations) -> list[tuple[str, float]]:
    found: list[tuple[str, float]] = []
    total = 0
    for bound, count in zip([*map(str, BOUNDS), "+Inf"], durations.counts, strict=True):
        total += count
        found.append((bound, total))
    return found


def _members(status: WorldStatus) -> Iterator[Metric]:
    there = GaugeMetricFamily(
        "minerva_members", "Members by role and state.", labels=["world", "role", "state"]
    )
    counts = Counter((role, one.state) for one in status.members for role in one.roles or ("none",))
    for (role, state), count in sorted(counts.items()):
        there.add_metric([status.world, role, state], count)
    yield there
    wait = GaugeMetricFamily(
        "minerva_member_wait_seconds", "For how long a frame waits for a member's answers, mean.",
        labels=["world", "member"],
    )  # fmt: skip
    for one in status.members:
        wait.add_metric([status.world, one.name], one.wait * _MICRO)
    yield wait
    refused = CounterMetricFamily(
        "minerva_refused", "What was refused, by whose it was.", labels=["world", "who"]
    )
    for who, count in sorted(status.refused.items()):
        refused.add_metric([status.world, who], count)
    yield refused
    for name, (words, figure) in _COUNTED.items():
        family = CounterMetricFamily(name, words, labels=["world", "member"])
        for one in status.members:
            family.add_metric([status.world, one.name], figure(one))
        yield family


def _dropped(member: MemberStatus) -> float:
    dropped = member.figures.get("dropped", 0)
    return dropped if isinstance(dropped, int | float) else 0


_COUNTED: Mapping[str, tuple[str, Callable[[MemberStatus], float]]] = {
    "minerva_late_answers": ("Answers that came when nobody waited for them.", lambda m: m.late),
    "minerva_dropped_events": ("Events of which too many waited already.", _dropped),
    "minerva_restarts": ("How often a member has come again.", lambda m: max(0, m.joins - 1)),
}
