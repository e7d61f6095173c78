"""Runs the cases of the conformance suite against a coordinator."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from minerva_bus.errors import MisuseError
from minerva_conformance.case import CoordinatorRole
from minerva_conformance.cases.coordinators import COORDINATORS
from minerva_conformance.coordinating import Script, play_scripts
from minerva_conformance.launching import command
from minerva_conformance.suite import ScoreCard, is_named


def is_coordinator(roles: Sequence[str]) -> bool:
    """Whether the role is `coordinator`. Raises MisuseError if there are roles of members too."""
    if CoordinatorRole.COORDINATOR not in roles:
        return False
    if len(set(roles)) > 1:
        raise MisuseError("check a coordinator and members in separate runs: --role coordinator")
    return True


def select_scripts(names: Collection[str] = ()) -> tuple[Script, ...]:
    """The cases with these names, or whose names begin with `NAME.`; all without names.

    `coordinator.` may be left out. Raises MisuseError if nothing is selected.
    """
    wanted = [name if name.startswith("coordinator") else f"coordinator.{name}" for name in names]
    for name in wanted:
        if not any(is_named(script.case, name) for script in COORDINATORS):
            raise MisuseError(
                f"there is no case {name!r}; `minerva conformance --role coordinator --list`"
            )
    return tuple(
        [
            script
            for script in COORDINATORS
            if not wanted or any(is_named(script.case, name) for name in wanted)
        ]
    )


def run_coordinator_suite(words: Sequence[str], *, cases: Collection[str] = ()) -> ScoreCard:
    """Play cases against a coordinator.

    Args:
        words: the program and its arguments. It runs the world of the suite under the name
            MINERVA_WORLD and listens at MINERVA_LISTEN.
        cases: names of cases or groups; default: all.

    Raises MisuseError if there is no such case or program.

    """
    results = play_scripts(command(words), select_scripts(cases))
    return ScoreCard((CoordinatorRole.COORDINATOR,), tuple(results))
