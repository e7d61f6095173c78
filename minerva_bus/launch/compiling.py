"""Compiled methods of a world's agents: `[world] compiled`, and compiling before the start."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from minerva_bus.errors import WorldFileError
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.wording import counted
from minerva_bus.world.accelerator import IF_POSSIBLE, Mode, NotCompilable, compile_all
from minerva_bus.world.agent import Agent


def apply_mode(processes: Sequence[ProcessSpec], mode: Mode, path: Path) -> list[str]:
    """Mark methods and views of all agent classes as `[world] compiled` asks; returns lines.

    Raises WorldFileError if one cannot be compiled and `mode` is True.
    """
    notes: list[str] = []
    for cls in _classes(processes):
        try:
            notes += [f"not compiled: {_first(reason)}" for reason in compile_all(cls, mode)]
        except NotCompilable as error:
            raise WorldFileError(
                f'{path}: [world] compiled = true: {error}\n  or: compiled = "{IF_POSSIBLE}"'
            ) from None
    if mode == IF_POSSIBLE:
        made = [cls.accelerator for cls in _classes(processes) if cls.accelerator is not None]
        methods = counted(sum(len(each.methods) for each in made), "method")
        views = counted(sum(len(each.views) for each in made), "view")
        notes.insert(0, f"compiled {methods} and {views} of agents")
    return notes


def compile_agents(
    processes: Iterable[ProcessSpec], progress: Callable[[str, int, int, str], None]
) -> None:
    """Compile the methods of the agents that run on this machine, and the rules of their spaces.

    Before the launcher starts processes, so that they inherit the machine code. Raises MisuseError
    without numba, or if a rule cannot be compiled.
    """
    local = [process for process in processes if not process.elsewhere]
    compile_classes(_classes(local), progress)


def compile_classes(
    classes: Iterable[type[Agent]], progress: Callable[[str, int, int, str], None]
) -> None:
    """Compile the methods and rules of agent classes. Raises MisuseError like `compile_agents`."""
    code = [each for cls in classes for each in cls.machine_code()]
    for done, (title, compiled) in enumerate(code):
        progress("compiling", done, len(code), title)
        compiled()


def no_progress(name: str, done: int, total: int, rest: str) -> None:
    """Show no progress."""


def _classes(processes: Iterable[ProcessSpec]) -> list[type[Agent]]:
    """The agent classes of processes, each once."""
    return list(dict.fromkeys(cls for process in processes for cls in process.agents))


def _first(reason: str) -> str:
    """The problem of a method and its place, on one line."""
    problem, *place = reason.split("\n")
    return f"{problem} ({place[0].strip()})" if place else problem
