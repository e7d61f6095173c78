"""The list of mutants that no test kills, and the verdicts of a run; see `tools.mutation`."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SURVIVORS = ROOT / "tools" / "survivors.toml"
HEAD = """\
# Mutants of the core that no test kills, and why that is accepted; written by
# `python -m tools.mutation --record`, with reasons written by hand. See docs/testing.md.
# [run] has the counts of the last finished run of each module. Modules that are not listed
# have not been run.
"""


@dataclass(frozen=True)
class Survivor:
    """A mutant that no test kills: its change, and the reason for accepting it."""

    module: str
    function: str
    mutation: str
    reason: str = ""

    @property
    def key(self) -> tuple[str, str, str]:
        """Identity across runs, independent of its number."""
        return self.module, self.function, self.mutation


@dataclass(frozen=True)
class Result:
    """The verdicts on a module's mutants."""

    module: str
    verdicts: dict[str, str]
    survivors: tuple[Survivor, ...]
    same: int = 0
    """Number of mutants that only change the type of a cast, which has no effect at run time."""
    all: int | None = None
    """Number of mutants from which a sample was drawn; None if it was not a sample."""

    @property
    def waiting(self) -> int:
        """Number of mutants without a verdict."""
        return sum(verdict == "not checked" for verdict in self.verdicts.values())

    @property
    def counts(self) -> dict[str, int]:
        """Counts for [run]."""
        total, alive = len(self.verdicts) - self.same, len(self.survivors)
        sample = {} if self.all is None else {"mutants": self.all, "sampled": total}
        judged = {"killed": total - alive - self.waiting, "survived": alive}
        return (sample or {"mutants": total}) | judged


def read_survivors(path: Path = SURVIVORS) -> tuple[dict[str, dict[str, int]], list[Survivor]]:
    """The recorded counts by module, and the accepted survivors."""
    if not path.exists():
        return {}, []
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    return data.get("run", {}), [Survivor(**entry) for entry in data.get("survivor", [])]


def write_survivors(
    runs: dict[str, dict[str, int]], survivors: list[Survivor], path: Path = SURVIVORS
) -> None:
    """Write the list: runs by module, survivors by module, function and mutation."""
    lines = [HEAD, "[run]"]
    for module in sorted(runs):
        counts = ", ".join(f"{name} = {count}" for name, count in runs[module].items())
        lines.append(f"{json.dumps(module)} = {{ {counts} }}")
    for survivor in sorted(survivors, key=lambda entry: entry.key):
        lines += ["", "[[survivor]]"]
        lines += [f"{name} = {_quoted(text)}" for name, text in vars(survivor).items()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def compared(result: Result, accepted: list[Survivor]) -> tuple[list[Survivor], list[Survivor]]:
    """Survivors without a reason, and accepted ones that no longer survive."""
    reasons = {entry.key: entry.reason for entry in accepted if entry.module == result.module}
    new = [entry for entry in result.survivors if not reasons.get(entry.key)]
    keys = {entry.key for entry in result.survivors}
    gone = [entry for entry in accepted if entry.module == result.module and entry.key not in keys]
    is_whole = not result.waiting and result.all is None
    return new, gone if is_whole else []


def recorded(result: Result, path: Path = SURVIVORS) -> None:
    """Update the list with a finished run: reasons stay, obsolete entries go.

    A sample says nothing about mutants outside of it, so their entries stay, too.
    """
    runs, accepted = read_survivors(path)
    reasons = {entry.key: entry.reason for entry in accepted}
    entries = {entry.key: entry for entry in result.survivors}
    others = [
        entry
        for entry in accepted
        if entry.module != result.module or (result.all is not None and entry.key not in entries)
    ]
    own = [replace(entry, reason=reasons.get(entry.key, "")) for entry in entries.values()]
    write_survivors({**runs, result.module: result.counts}, others + own, path)


def only_a_cast(mutation: str) -> bool:
    """Whether a mutation only changes the type argument of `cast`."""
    plain = re.sub(r'cast\((?:"[^"]*"|None),', "cast(_,", mutation)
    removed = [line[2:] for line in plain.splitlines() if line.startswith("-")]
    return removed == [line[2:] for line in plain.splitlines() if line.startswith("+")]


def _quoted(text: str) -> str:
    return f"'''\n{text}'''" if "\n" in text else json.dumps(text, ensure_ascii=False)
