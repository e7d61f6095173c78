"""`minerva determinism`: run a world in two layouts of processes and compare the records."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from minerva_analysis.comparing import Difference
from minerva_bus.cli.output import FAILED, WRONG, print_json, print_message, print_result
from minerva_bus.errors import MisuseError
from minerva_bus.launch.console import progress_bar
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.wording import counted
from minerva_determinism.layouts import ALONE, APART, OMITTED, first_difference, run_in_layout
from minerva_determinism.suspects import Suspect, causes, suspects


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result: the exit code, the difference if both runs ended, or how one of them failed.

    `omitted`: the processes that were left out, with the reasons.
    `suspects`: lines of code that can be the cause, or make other runs differ.
    """

    code: int
    difference: Difference | None = None
    error: str = ""
    omitted: dict[str, str] | None = None
    suspects: tuple[Suspect, ...] = ()

    def plain(self) -> dict[str, Any]:
        """The verdict as a JSON object."""
        plain: dict[str, Any] = {"ok": not self.code, "not_compared": self.omitted or {}}
        if self.error:
            plain["error"] = self.error
        if self.suspects:
            plain["suspects"] = [each.plain() for each in self.suspects]
        return plain | (self.difference.plain() if self.difference is not None else {})

    def lines(self) -> list[str]:
        """The verdict as text."""
        omitted = [f"not compared: {name} ({why})" for name, why in (self.omitted or {}).items()]
        if self.difference is None:
            return [*self.error.split("\n"), *omitted]
        if self.difference.same:
            same = f"the same in both runs: {counted(self.difference.frames, 'frame')}"
            return [same, *omitted, *causes(self.suspects, same=True)]
        if self.difference.frame is None and not self.difference.frames:
            return [*self.difference.lines(), *omitted]
        sides = [f"  A: {ALONE.name}", f"  B: {APART.name}"]
        shown = [*sides, *self.difference.lines(), *omitted, *causes(self.suspects)]
        return ["two runs differ", *shown]


def check_determinism(spec: str, frames: int, as_json: bool) -> int:
    """Run a world twice and print the first difference; returns the exit code.

    Raises WorldFileError if there is no such world, and MisuseError if it is not a world.
    """
    path = world_path(spec)
    with TemporaryDirectory(prefix="minerva-") as folder, progress_bar("runs") as progress:
        verdict = _verdict(path, frames, Path(folder), progress)
    if as_json:
        print_json({"file": spec, **verdict.plain()})
    else:
        first, *rest = verdict.lines()
        (print_message if verdict.code else print_result)("\n".join([f"{spec}: {first}", *rest]))
    return verdict.code


def world_path(spec: str) -> Path:
    """The world file of a path or an installed name. Raises WorldFileError and MisuseError."""
    if Path(spec).suffix == ".mnv":
        raise MisuseError(f"{spec}: determinism runs a world, and a string alone is none")
    return find_world(spec)


def _verdict(
    path: Path, frames: int, folder: Path, progress: Callable[[int, int], None]
) -> Verdict:
    records: list[Path] = []
    for number, layout in enumerate((ALONE, APART)):
        progress(number, 2)
        records.append(folder / f"{number}.mcap")
        # One after the other, because both worlds have the same name and runtime folder.
        done = run_in_layout(path, frames, layout, records[-1])
        if done.returncode:
            text = done.stderr.strip() or "it ended without a message"
            how = f"it fails in {layout.name}:\n{text}"
            wrong = done.returncode == WRONG
            return Verdict(done.returncode if wrong else FAILED, error=text if wrong else how)
    omitted = json.loads((folder / OMITTED).read_text(encoding="utf-8"))
    difference = first_difference(records[0], records[1], ("A", "B"))
    listed = tuple(suspects(read_world_file(path)))
    return Verdict(0 if difference.same else FAILED, difference, "", omitted, listed)
