"""The state of a running world, as operators ask for it."""

from __future__ import annotations

from dataclasses import replace

from minerva_bus.frame.members import MemberEntry
from minerva_bus.runtime.operated import Operated
from minerva_bus.world.operator import MemberStatus, WorldStatus


def status_of(running: Operated, since: int = 0) -> WorldStatus:
    """State of a world, with the log entries since a number."""
    algorithm, pace, hz = running.algorithm, running.pace, running.status.hz
    measured = dict(running.metrics.measured())
    waits = {
        name.removeprefix("wait for "): measured.pop(name)
        for name in sorted(measured)
        if name.startswith("wait for ")
    }
    waiting = tuple(algorithm.waiting_for())
    members = [_member(entry, waits.get(entry.name, 0.0)) for entry in algorithm.members]
    return WorldStatus(
        world=algorithm.world.name,
        frame=algorithm.frame,
        dt=algorithm.world.dt,
        phase=algorithm.phase.value,
        paused=pace.paused,
        left=pace.left or 0,
        rate=pace.rate,
        hz=hz,
        agents=algorithm.composition.count,
        waiting=waiting,
        # Measured a moment ago, when the frame may have waited for members that have answered.
        waited=running.status.waited if waiting else 0.0,
        members=tuple(
            replace(member, outlook=running.outlook(member.name))
            if member.name in waiting
            else member
            for member in members
        ),
        events={name: count * hz for name, count in running.event_log.per_frame().items()},
        bytes_in=measured.pop("bytes in", 0.0),
        bytes_out=measured.pop("bytes out", 0.0),
        phases=measured,
        happenings=running.event_log.entries(since),
        refused=running.rejected(),
        late_frames=running.schedule.overruns.count,
        behind=running.schedule.overruns.behind,
        series=0 if running.collected is None else len(running.collected),
        norms=algorithm.norms.status(),
        files=running.files(),
        people=algorithm.world.people,
    )


def _member(member: MemberEntry, wait: float) -> MemberStatus:
    hello = member.hello
    if hello is None:
        return MemberStatus(member.name, member.state.value, expected=member.expected)
    return MemberStatus(
        name=member.name,
        state="drained" if member.active and member.drained else member.state.value,
        roles=hello.roles,
        service=hello.service,
        kinds=tuple([kind.name for kind in hello.kinds]),
        generates=hello.generates,
        orders=hello.orders,
        draws=hello.draws,
        last_reply=member.last_reply,
        late=member.late,
        pid=hello.pid,
        host=hello.host,
        expected=member.expected,
        joins=member.joins,
        wait=wait,
        figures={**member.figures, **({"dropped": member.dropped} if member.dropped else {})},
    )
