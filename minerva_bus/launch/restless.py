"""Warnings about norms whose rejected agents would not rest, as docs/norms.md explains.

A coupled device executes the actions that agents show. An agent with a rejected step keeps its
action, unless its kind declares the attributes of an agent at rest.
"""

from __future__ import annotations

from collections.abc import Iterator

from minerva_bus.launch.worldfile import WorldFile


def restless(file: WorldFile) -> list[str]:
    """A warning for each norm and kind whose rejected agents would repeat the same step."""
    refusing = [norm for norm in file.world.norms if norm.refuses and not norm.on]
    kinds = file.world.vocabulary.kinds.values()
    restless = [kind for kind in kinds if kind.subscribes and not kind.rest]
    if not refusing or not restless:
        return []
    shown = list(_shown(file))
    return [
        f"norm.{norm.name} rejects steps of {kind.name}, which {device} executes: without `rest`"
        " the agent retries the rejected action in each frame; declare its action, such as"
        f' class X(Agent, symbol="{kind.name}", rest=("action",))'
        for norm in refusing
        for kind in restless
        for device in [name for name, types in shown if types & kind.views][:1]
        if norm.concerns(kind.name)
    ]


def _shown(file: WorldFile) -> Iterator[tuple[str, frozenset[str]]]:
    """The coupled devices, with the visual event types that they draw."""
    for process in file.processes:
        if process.make_service is not None:
            hello = process.participant().hello()
            if hello.coupled:
                yield process.name, frozenset(hello.draws)
