"""Hosts of a region, for the operator of the world: metrics of the region, and rows made of them.

The coordinator of the world has no other knowledge of hosts, which are members of their region.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.capacity import agents_in
from minerva_bus.frame.member_states import MemberState
from minerva_bus.frame.members import Members
from minerva_bus.world.operator import MemberStatus

_SEPARATOR: Final = "/"
"""Between a host and what is reported of it; no name of a member and no other metric has it."""

_WAITING: Final = "waiting"
"""What is reported of a host for which a frame of its region waits."""

_AGENTS: Final = "agents"
"""What is reported of a host that evolves some: their number."""

_TEXTS: Final = "state", "kinds", "host", "outlook"
_NUMBERS: Final = "pid", "joins", "last_reply"


def agents_of_hosts(algorithm: FrameAlgorithm) -> Mapping[str, int]:
    """The number of agents that each host of a region evolves."""
    counts = Counter[str]()
    for name, fragment in algorithm.composition.fragments.items():
        host = algorithm.placement.host_of(name)
        if host is not None:
            counts[host] += agents_in(fragment)
    return counts


def host_figures(
    members: Members,
    own: Iterable[str],
    region: str = "",
    waiting: Mapping[str, str] | None = None,
    agents: Mapping[str, int] | None = None,
) -> m.Figures:
    """The metrics of a region about its hosts: its members but its `own`, which have no process.

    The name of the `region` begins that of each: a host that has attached may have any. `waiting`
    are those for which a frame waits, with what follows; `agents` are the numbers that each has.
    """
    waiting, agents = waiting or {}, agents or {}
    names, figures = frozenset(own), dict[str, bool | int | float | str]()
    prefix = f"{region}." if region else ""
    for member in members:
        if member.name in names or (not member.expected and member.state is MemberState.LEFT):
            continue
        hello, name = member.hello, f"{prefix}{member.name.removeprefix(prefix)}"
        of_host: dict[str, int | str] = {"state": member.state.value, "joins": member.joins}
        of_host["expected"] = member.expected
        if member.name in waiting:
            of_host |= {_WAITING: True, "outlook": waiting[member.name]}
        if member.name in agents:
            of_host[_AGENTS] = agents[member.name]
        of_host["last_reply"] = member.last_reply
        if hello is not None:
            kinds = " ".join(kind.name for kind in hello.kinds)
            of_host |= {"kinds": kinds, "pid": hello.pid, "host": hello.host}
        for what, value in of_host.items():
            figures[f"{name}{_SEPARATOR}{what}"] = value
    return figures


def without_hosts(figures: m.Figures) -> m.Figures:
    """The metrics of a member but those about hosts."""
    return {name: value for name, value in figures.items() if _SEPARATOR not in name}


def hosts_in(members: Members) -> list[MemberStatus]:
    """The hosts of all regions, by the metrics of these, sorted by name."""
    hosts: dict[str, dict[str, Any]] = {}
    for region in members:
        prefix = f"{region.name}."
        for name, value in region.figures.items():
            host, separator, what = name.partition(_SEPARATOR)
            # A member may report any metric, but only about hosts of its own.
            if separator and host.startswith(prefix):
                hosts.setdefault(host, {})[what] = value
    return [_status(name, of_host) for name, of_host in sorted(hosts.items())]


def awaited(members: Members, waiting: Iterable[str]) -> list[str]:
    """The members for which a frame waits; instead of a region its hosts, if it waits for these."""
    shown: list[str] = []
    for name in waiting:
        ends = [each.partition(_SEPARATOR) for each in members.get(name).figures]
        hosts = [host for host, _, what in ends if what == _WAITING and host.startswith(f"{name}.")]
        shown += sorted(hosts) or [name]
    return shown


def _status(name: str, of_host: Mapping[str, Any]) -> MemberStatus:
    texts = {what: str(of_host.get(what, "")) for what in _TEXTS}
    numbers = {what: _number(of_host.get(what)) for what in _NUMBERS}
    return MemberStatus(
        name,
        texts["state"],
        roles=("agents",),
        kinds=tuple(texts["kinds"].split()),
        pid=numbers["pid"],
        host=texts["host"],
        expected=of_host.get("expected") is True,
        joins=numbers["joins"],
        last_reply=numbers["last_reply"],
        outlook=texts["outlook"],
        figures={_AGENTS: _number(of_host[_AGENTS])} if _AGENTS in of_host else {},
    )


def _number(value: object) -> int:
    return value if type(value) is int else 0
