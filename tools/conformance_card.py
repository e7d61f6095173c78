"""The score card of the naive member in docs/howto/other-languages.md.

    python -m tools.conformance_card            # compare; exit code 1 if it differs
    python -m tools.conformance_card --write    # write it

In the page it is between `<!-- card: naive -->` and `<!-- end of card -->`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from minerva_conformance.case import CaseOutcome, CaseResult, Tier
from minerva_conformance.suite import run_suite
from minerva_conformance.world import MemberRole
from tools import blocks
from tools.protocol_tables import table

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "howto" / "other-languages.md"
NAIVE = ROOT / "extensions" / "conformance" / "tests" / "naive.py"


def card(results: Iterable[CaseResult]) -> str:
    """Passed and applicable cases of each role and tier, as a table in Markdown."""
    results = tuple(results)
    return "\n" + table(
        ["role", *Tier],
        [[role, *(_share(results, role, tier) for tier in Tier)] for role in MemberRole],
    )


def _share(results: Iterable[CaseResult], role: MemberRole, tier: Tier) -> str:
    outcomes = [r.outcome for r in results if (r.role, r.case.tier) == (role, tier)]
    applicable = len(outcomes) - outcomes.count(CaseOutcome.NOT_APPLICABLE)
    return f"{outcomes.count(CaseOutcome.PASSED)} of {applicable}"


def with_card(page: str, results: Iterable[CaseResult]) -> str:
    """The page with the score card up to date."""
    return blocks.filled(page, "card", lambda _: card(results))


def main() -> int:
    parser = argparse.ArgumentParser(description="the score card of the naive member")
    parser.add_argument("--write", action="store_true", help="write it")
    write = parser.parse_args().write
    page = PAGE.read_text(encoding="utf-8")
    played = run_suite([sys.executable, str(NAIVE)], roles=[role.value for role in MemberRole])
    wanted = with_card(page, played.results)
    if write:
        PAGE.write_text(wanted, encoding="utf-8")
        return 0
    print("the score card is up to date" if page == wanted else "run with --write")
    return int(page != wanted)


if __name__ == "__main__":
    sys.exit(main())
