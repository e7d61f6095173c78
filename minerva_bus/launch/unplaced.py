"""Warnings about agents that `[placement]` allows on no process of a world file.

It is no error, because a process with such a name may attach while the world runs.
"""

from __future__ import annotations

from collections.abc import Iterator

from minerva_bus.errors import nearest
from minerva_bus.frame.constraints import Rule
from minerva_bus.launch.worldfile import Process, WorldFile


def unplaced(file: WorldFile) -> list[str]:
    """A warning for each rule that keeps agents from all processes of the file."""
    rules = file.world.placement.rules
    return [
        f"placement.{kind}: {problem}; {kind} does not evolve until one attaches"
        for kind, rule in rules.items()
        for problem in _problems(file, kind, rule)
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
