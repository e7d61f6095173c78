"""Judge Minerva Bus by suites that others wrote; nothing is fetched.

    python -m tools.acceptance                  # all suites that are there
    python -m tools.acceptance msgpack mcap     # some
    python -m tools.acceptance --write          # their scores into docs/acceptance.md

Each suite is a clone of its repository in a folder, by default `acceptance` beside the project.
A missing suite is skipped. The exit code is 1 if a case fails, 2 for a wrong argument.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from tools import blocks
from tools.acceptance.assistants import CONFORMANCE
from tools.acceptance.bags import ROSBAG2, SICK
from tools.acceptance.codec import MSGPACK
from tools.acceptance.environments import FARAMA
from tools.acceptance.federates import HELICS
from tools.acceptance.library import NETLOGO
from tools.acceptance.maps import NAV2
from tools.acceptance.messaging import PAHO
from tools.acceptance.models import REFERENCE_FMUS
from tools.acceptance.positions import GPSD, PYNMEAGPS
from tools.acceptance.records import MCAP
from tools.acceptance.routing import MAPF
from tools.acceptance.suite import MissingSuiteError, Outcome, Result, Score, Suite
from tools.acceptance.traffic import SUMO

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "acceptance.md"
_END = "<!-- end of scores -->"
SUITES = {
    suite.name: suite
    for suite in (
        MSGPACK,
        MCAP,
        GPSD,
        PYNMEAGPS,
        ROSBAG2,
        REFERENCE_FMUS,
        PAHO,
        HELICS,
        NAV2,
        CONFORMANCE,
        MAPF,
        FARAMA,
        NETLOGO,
        SICK,
        SUMO,
    )
}


def played(names: Iterable[str], folder: Path) -> tuple[list[Score], list[str]]:
    """Scores of these suites, and those that were skipped, each with the reason."""
    scores: list[Score] = []
    skipped: list[str] = []
    for name in names:
        suite = SUITES[name]
        try:
            scores.append(Score(suite, suite.results(folder)))
        except MissingSuiteError as error:
            skipped.append(f"{name}: skipped: {error}")
    return scores, skipped


def lines(score: Score) -> list[str]:
    """A score for the terminal."""
    counts = ", ".join(f"{score.count(outcome)} {outcome}" for outcome in Outcome)
    return [
        f"{score.suite.name}: {len(score.results)} cases: {counts}",
        *(f"  {count} expected: {reason}" for reason, count in score.reasons()),
        *(f"  FAILED {failure}" for failure in score.failures()),
    ]


def section(page: str, scores: Iterable[Score]) -> str:
    """The scores as Markdown: a table, then the reasons of each suite.

    Suites without a score keep those of the page.
    """
    written = page.partition(_END)[0]
    rows = {row.split("`")[1]: row for row in re.findall(r"^\| `.*\n", written, re.M)}
    reasons = {part.partition("\n")[0]: part for part in written.split("\n## ")[1:]}
    for score in scores:
        name = score.suite.name
        rows[name] = _row(
            [f"`{name}`", _source(score.suite), score.suite.judges]
            + [str(score.count(outcome)) for outcome in Outcome]
        )
        listed = [f"- {count} expected: {reason}" for reason, count in score.reasons()]
        listed += [f"- failed: {failure}" for failure in score.failures()]
        paragraphs = ["".join(f"{line}\n" for line in listed), "".join(_figures(score.results))]
        paragraphs = [paragraph for paragraph in paragraphs if paragraph]
        reasons[name] = "\n".join([f"{name}\n", *paragraphs]) if paragraphs else ""
    heads = ["suite", "source", "judges", "passed", "expected", "failed"]
    parts = [*_heads(heads), *(rows.get(name, "") for name in SUITES)]
    parts += [f"\n## {reasons[name]}" for name in SUITES if reasons.get(name)]
    return "\n" + "".join(parts)


def _figures(results: Iterable[Result]) -> Iterator[str]:
    """The rows of a table of what was measured in the cases."""
    heads: Iterable[str] = ()
    for result in results:
        if result.figures and not heads:
            heads = result.figures
            yield from _heads(["case", *heads])
        if result.figures:
            yield _row([result.case, *(result.figures.get(head, "") for head in heads)])


def _heads(names: list[str]) -> list[str]:
    return [_row(names), _row(["---"] * len(names))]


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |\n"


def _source(suite: Suite) -> str:
    return f"[{suite.repository}](https://github.com/{suite.repository}), `{suite.path}`"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tools.acceptance", description="judge the project by suites of others"
    )
    # Without `choices`, which would refuse the empty list.
    parser.add_argument("suite", nargs="*", help=f"{', '.join(SUITES)}; default: all")
    parser.add_argument(
        "--folder",
        type=Path,
        default=os.environ.get("MINERVA_ACCEPTANCE") or ROOT.parent / "acceptance",
        help="folder of the clones; default: MINERVA_ACCEPTANCE, or `acceptance` beside the"
        " project",
    )
    parser.add_argument("--write", action="store_true", help=f"write the scores into {PAGE.name}")
    given = parser.parse_args()
    if unknown := set(given.suite) - set(SUITES):
        parser.error(f"no suite {', '.join(sorted(unknown))}; expected {', '.join(SUITES)}")
    if given.folder.resolve().is_relative_to(ROOT):
        parser.error(f"{given.folder} is in the project; suites of others lie outside of it")
    scores, skipped = played(given.suite or SUITES, given.folder)
    print("\n".join([*(line for score in scores for line in lines(score)), *skipped]))
    if given.write:
        page = PAGE.read_text(encoding="utf-8")
        filled = blocks.filled(page, "scores", lambda _: section(page, scores))
        PAGE.write_text(filled, encoding="utf-8")
    return int(any(score.count(Outcome.FAILED) for score in scores))


if __name__ == "__main__":
    sys.exit(main())
