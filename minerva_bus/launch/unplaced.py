"""Warnings about agents that no process of a world file may evolve, and topics that none publishes.

They are no errors, because such a process may attach while the world runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from minerva_bus.errors import nearest
from minerva_bus.frame.constraints import Rule
from minerva_bus.frame.member import Member
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.settings.kinds import ALL


def unplaced(file: WorldFile) -> list[str]:
    """A warning for each rule that keeps agents from all processes of the file."""
    rules = file.world.placement.rules
    return [
        f"placement.{kind}: {problem}; {kind} does not evolve until one attaches"
        for kind, rule in rules.items()
        for problem in _problems(file, kind, rule)
    ]


def unpublished(file: WorldFile, members: Iterable[Member]) -> list[str]:
    """A warning for each topic that is read or recorded, and published by no process of the file.

    `members` are those of its processes, of which it compares the topics.
    """
    # What a program in another language publishes is known only when it joins.
    if any(process.command for process in file.processes):
        return []
    hellos = [member.hello() for member in members]
    known = sorted({topic for hello in hellos for topic in hello.publishes})
    wanted = {topic: "record" for topic in file.record.topics if topic != ALL}
    wanted |= {topic: hello.member for hello in hellos for topic in hello.topics}
    return [
        f"{who}: no process publishes the topic {topic!r}{nearest(topic, known)}; it has no"
        " readings until one attaches"
        for topic, who in sorted(wanted.items())
        if topic not in known
    ]


def _problems(file: WorldFile, kind: str, rule: Rule) -> Iterator[str]:
    hosts = [process.name for process in file.processes if _may_host(process, kind)]
    # Only names matter here: the machines are those of a run.
    if not any(Rule(rule.only).allows(host, {}) for host in hosts):
        names = " or ".join(map(repr, rule.only))
        known = f"there are {', '.join(hosts) or 'none'}"
        hint = next((hint for name in rule.only if (hint := nearest(name, hosts))), f"; {known}")
        yield f"no process that may have such agents has the name {names}{hint}"
    members = [process.name for process in file.processes]
    if rule.near and rule.near not in members:
        known = f"there are {', '.join(members)}"
        yield f"near: there is no process {rule.near!r}{nearest(rule.near, members, known)}"


def _may_host(process: Process, kind: str) -> bool:
    # What a program in another language hosts is known only when it joins.
    return bool(process.command) or any(agent.kind.name == kind for agent in process.agents)
