"""The suite is passed by the Python members, and by one written from PROTOCOL.md alone."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from threads import naive_member, own_member

from minerva_conformance import report
from minerva_conformance.case import CaseOutcome, Tier
from minerva_conformance.launching import StartMember
from minerva_conformance.scripted_world import ScriptedHub
from minerva_conformance.suite import ScoreCard, Suite
from minerva_conformance.world import MemberRole
from tools.conformance_card import PAGE, with_card


@pytest.fixture(scope="module")
def hub() -> Iterator[ScriptedHub]:
    with ScriptedHub() as hub:
        yield hub


def played(start: StartMember, role: MemberRole, hub: ScriptedHub) -> ScoreCard:
    card = Suite(start, hub).run(roles=[role])
    assert "\n".join(report.problems(card)) == ""
    assert report.blocked(card) == 0
    assert card.reached is Tier.ROBUST
    return card


@pytest.mark.parametrize("role", MemberRole)
def test_a_python_member_passes(role: MemberRole, hub: ScriptedHub) -> None:
    card = played(own_member(), role, hub)
    # A Python member has every capability but the one to decline columns.
    left_out = [r.problem for r in card.results if r.outcome is CaseOutcome.NOT_APPLICABLE]
    assert [problem for problem in left_out if "plain" not in problem] == (
        [] if role is MemberRole.GENERATOR else left_out
    )


def test_the_naive_member_passes_and_its_score_card_is_in_the_docs(hub: ScriptedHub) -> None:
    results = [
        result for role in MemberRole for result in played(naive_member(), role, hub).results
    ]
    page = PAGE.read_text(encoding="utf-8")
    assert with_card(page, results) == page, "python -m tools.conformance_card --write"


def test_the_naive_member_uses_zenoh_and_messagepack_only() -> None:
    tree = ast.parse(Path(__file__).with_name("naive.py").read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}  # fmt: skip
    names |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not {name for name in names if name.startswith("minerva")}
    assert {"zenoh", "msgpack"} <= names
