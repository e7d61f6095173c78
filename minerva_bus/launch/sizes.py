"""Check that the initial string fits into the messages that send it to the hosts.

A host receives all of its fragments in one message. A message that is too long is reported before
any process starts: a member that cannot read it would fail at each restart.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Final

from minerva_bus.errors import WorldFileError
from minerva_bus.frame.fragments import PART, Fragment
from minerva_bus.frame.member import Member
from minerva_bus.frame.messages import Fragments
from minerva_bus.frame.placement import kinds_of
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.worldfile import Process
from minerva_bus.wire.codec import encode
from minerva_bus.wire.limits import DEFAULT
from minerva_bus.wording import counted

MAX_BYTES: Final = DEFAULT.message_bytes
"""Size of the largest message that a member reads."""


def check_sizes(fragments: Mapping[str, Fragment], processes: Iterable[Process]) -> None:
    """Raise WorldFileError if a host would receive a message that it cannot read.

    Fragments of the same kinds are distributed among all processes that offer them, so one of
    these gets at least an equal share. Hosts that may be attached later do not count.
    """
    offers = [_offered(process) for process in processes if process.agents]
    for kinds, group in _by_kinds(fragments).items():
        hosts = sum(kinds <= offered for offered in offers)
        size = _size(group)
        if hosts and size > MAX_BYTES * hosts:
            more = f"Use {-(-size // MAX_BYTES)} or more processes for them, or start"
            agents = f"the agents of {', '.join(sorted(kinds))} are"
            raise WorldFileError(_text(agents, size, f" for {counted(hosts, 'process')}", more))
        for name in group if hosts and size > MAX_BYTES else ():
            # A part of a population can be divided further, an agent with its scope cannot.
            own = 0 if name.startswith(PART) else _size({name: group[name]})
            if own > MAX_BYTES:
                raise WorldFileError(_text(f"the agent {name} with its scope is", own, "", "Start"))


def _offered(process: Process) -> frozenset[str]:
    hello = Member(process.name, None, process.agents).hello()
    return frozenset(kind.name for kind in hello.kinds)


def _by_kinds(fragments: Mapping[str, Fragment]) -> Mapping[frozenset[str], dict[str, Fragment]]:
    groups: defaultdict[frozenset[str], dict[str, Fragment]] = defaultdict(dict)
    for name, node in fragments.items():
        groups[kinds_of(node)][name] = node
    return groups


def _size(group: Mapping[str, Fragment]) -> int:
    return len(encode(Fragments({name: Scene((node,)) for name, node in group.items()})))


def _text(what: str, size: int, shared: str, more: str) -> str:
    return (
        f"{what} {size:,} bytes on the bus{shared}; a message is limited to {MAX_BYTES:,}."
        f" {more} with a shorter string"
    )
