"""`minerva conformance`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from minerva_bus.cli.output import FAILED, print_json, print_message, print_result, print_table
from minerva_bus.errors import MisuseError
from minerva_bus.files import check_output, write_output
from minerva_bus.launch.child_processes import end_signals, handled
from minerva_conformance import report
from minerva_conformance.coordinator_suite import (
    is_coordinator,
    run_coordinator_suite,
    select_scripts,
)
from minerva_conformance.suite import roles_named, run_suite, select


def list_cases(cases: Sequence[str], roles: Sequence[str], as_json: bool) -> None:
    """Print the selected cases."""
    if is_coordinator(roles):
        selected = tuple([script.case for script in select_scripts(cases)])
    else:
        selected = select(cases, roles_named(roles))
    if as_json:
        print_json([report.described(case) for case in selected])
    else:
        print_table(report.listed(selected))


def check_conformance(
    command: Sequence[str],
    roles: Sequence[str],
    cases: Sequence[str],
    jobs: int,
    junit: Path | None,
    as_json: bool,
) -> int:
    """Play the cases and print the score card; returns the exit code."""
    if not command:
        raise MisuseError("name the member's program: minerva conformance -- PROGRAM ARGUMENT...")
    if junit is not None:  # Before the cases, which take some time.
        check_output(junit, "--junit")
    # As Ctrl-C, so that no member stays behind.
    with handled(dict.fromkeys(end_signals(), _interrupt)):
        if is_coordinator(roles):
            card = run_coordinator_suite(command, cases=cases)
        else:
            card = run_suite(command, cases=cases, roles=roles, jobs=jobs)
    if junit is not None:
        write_output(junit, report.as_junit(card).encode(), "--junit")
    if as_json:
        print_json(report.as_json(card))
    else:
        for problem in report.problems(card):
            print_message(problem)
        print_result(f"roles: {', '.join(card.roles)}")
        print_table(report.rows(card))
        print_result(f"reached: {card.reached or 'none'}")
    return 0 if card.passed else FAILED


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt
