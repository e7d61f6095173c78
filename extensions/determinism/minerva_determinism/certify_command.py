"""The answer of `minerva certify`: a row for each check as it ends, and the page."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from minerva_bus.cli.output import FAILED, print_json, print_message, print_result
from minerva_bus.errors import MisuseError
from minerva_bus.files import check_ending, check_output, write_output
from minerva_bus.launch.console import Console
from minerva_determinism.certificate import SAME, TITLES, CertificatePlan, Check, certify
from minerva_determinism.emulation import emulated
from minerva_determinism.report import page
from minerva_determinism.suspects import causes

WIDTHS: Final = (44, 9, 9, 17, 7)


def interpreters(
    commands: Sequence[str], architecture: str, folder: Path | None
) -> Mapping[str, Sequence[str]]:
    """Commands of other interpreters, by the name of their check; one may be emulated.

    Raises MisuseError if it cannot be emulated.
    """
    pythons = {command: shlex.split(command) for command in commands}
    if architecture and folder is not None:
        if not folder.exists():
            print_message(f"making a Python for {architecture} in {folder}")
        pythons[f"emulated {architecture}"] = [*emulated(architecture, folder)]
    elif architecture or folder is not None:
        raise MisuseError("--emulate and --setup need each other: a processor, and its folder")
    return pythons


def make_certificate(
    worlds: Sequence[str],
    frames: int,
    minutes: float,
    processes: Sequence[int],
    pythons: Mapping[str, Sequence[str]],
    report: Path | None,
    as_json: bool,
) -> int:
    """Certify worlds and print the certificate; returns the exit code.

    Raises WorldFileError, and MisuseError for a path of the page that cannot be written.
    """
    if report is not None:
        check_ending(report, (".html",), "--report")
        check_output(report)
    until = time.monotonic() + 60 * minutes
    shown = CheckRows(as_json)
    try:
        made = certify(
            worlds, CertificatePlan(frames, processes, pythons, until, shown, shown.begun)
        )
    finally:
        shown.console.end()
    if report is not None:
        write_output(report, page(made).encode())
    if as_json:
        print_json(made.plain())
    else:
        for world, omitted in made.omitted.items():
            for name, why in omitted.items():
                print_result(f"not compared: {name} of {world} ({why})")
        for world, suspects in made.suspects.items():
            if lines := causes(suspects, same=not made.differs(world)):
                print_result("\n".join([f"{world}:", *lines]))
        print_result(made.verdict())
    return 0 if made.is_complete else FAILED


class CheckRows:
    """Prints a row for each check: on standard output, or with `--json` where people read.

    A terminal also shows the check that runs.
    """

    def __init__(self, as_json: bool) -> None:
        self.console = Console()
        self._world = ""
        self._as_json = as_json

    def _print(self, text: str) -> None:
        if not self._as_json:
            print_result(text)
        elif sys.stderr.isatty():
            print_message(text)

    def begun(self, world: str, done: int, total: int, name: str) -> None:
        """Show in the status line what runs."""
        self.console.progress(world, done, total, name)

    def __call__(self, check: Check) -> None:
        self.console.end()
        if check.world != self._world:
            self._world = check.world
            self._print(_row([check.world, *TITLES[1:]]))
        self._print(_row(check.cells()))
        for line in check.lines:
            self._print(f"  {line}" if check.result == SAME else f"  ! {line}")


def _row(cells: Sequence[str]) -> str:
    padded = [cell.ljust(width) for cell, width in zip(cells, WIDTHS, strict=True)]
    return " ".join(padded).rstrip()
