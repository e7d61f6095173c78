"""A suite, the results of its cases, and its score."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import islice
from pathlib import Path

LFS_POINTER = b"version https://git-lfs"


class MissingSuiteError(Exception):
    """The files of a suite are not there; the message says what to do."""


class Outcome(StrEnum):
    """Outcome of a case."""

    PASSED = "passed"
    EXPECTED = "expected difference"
    FAILED = "failed"


@dataclass(frozen=True)
class Result:
    """The outcome of a case; `reason` explains a difference.

    `figures` are measurements for the page, by the heads of their columns.
    """

    case: str
    outcome: Outcome
    reason: str = ""
    figures: Mapping[str, str] = field(default_factory=dict[str, str])


def judged(case: str, problems: Iterable[str], expected: str = "") -> Result:
    """The result of a case: its first problem, which is `expected` for a reason, or None."""
    problem = next(iter(problems), None)
    if problem is None:
        return Result(case, Outcome.PASSED)
    return Result(case, *((Outcome.EXPECTED, expected) if expected else (Outcome.FAILED, problem)))


@dataclass(frozen=True)
class Suite:
    """Tests that others wrote: the repository and the path in it, and what they judge.

    `play` yields the results of the cases in a folder, which exists.
    """

    name: str
    repository: str
    path: str
    judges: str
    play: Callable[[Path], Iterator[Result]]

    def results(self, root: Path) -> list[Result]:
        """Results of all cases, in `root/REPOSITORY/PATH`. Raises MissingSuiteError."""
        folder = root / self.repository.partition("/")[2] / self.path
        if not folder.exists():
            raise MissingSuiteError(f"no {folder}; clone https://github.com/{self.repository}")
        results = list(self.play(folder))
        if not results:
            raise MissingSuiteError(f"{folder} has no cases")
        return results


def whole_files(paths: Iterable[Path]) -> Iterator[Path]:
    """These files in order. Raises MissingSuiteError if Git LFS has not fetched them."""
    for path in sorted(paths):
        with path.open("rb") as file:
            if file.read(len(LFS_POINTER)) == LFS_POINTER:
                raise MissingSuiteError(f"{path} is a pointer; run git lfs pull in its clone")
        yield path


@dataclass(frozen=True)
class Score:
    """Results of a suite, counted."""

    suite: Suite
    results: list[Result]

    def count(self, outcome: Outcome) -> int:
        """Number of cases with this outcome."""
        return sum(result.outcome is outcome for result in self.results)

    def reasons(self) -> list[tuple[str, int]]:
        """Reasons of the expected differences, and the number of cases of each."""
        expected = (r.reason for r in self.results if r.outcome is Outcome.EXPECTED)
        return Counter(expected).most_common()

    def failures(self, most: int = 20) -> list[str]:
        """The first failed cases, each with its reason."""
        failed = (r for r in self.results if r.outcome is Outcome.FAILED)
        return [f"{r.case}: {r.reason}" for r in islice(failed, most)]
