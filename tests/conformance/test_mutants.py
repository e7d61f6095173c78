"""A member that breaks one rule fails the cases about this rule, and no others."""

from collections.abc import Iterator

import pytest
from mutants import MUTANTS, Mutant
from threads import naive_member

from minerva_bus.runtime.scripted import ScriptedHub
from minerva_bus.testing.conformance import report
from minerva_bus.testing.conformance.case import Case, CaseOutcome
from minerva_bus.testing.conformance.cases import CASES
from minerva_bus.testing.conformance.suite import Suite, select
from minerva_bus.testing.conformance.world import MemberRole

SLOW = ("join.gone", "join.name")
"""Cases that wait for a time limit of the member: only for mutants that they concern."""


@pytest.fixture(scope="module")
def hub() -> Iterator[ScriptedHub]:
    with ScriptedHub() as hub:
        yield hub


def chosen(mutant: Mutant) -> tuple[Case, ...]:
    concerned = set(mutant.requirements.split())
    cases = select((), (MemberRole(mutant.role_name),))
    return tuple([c for c in cases if c.id not in SLOW or concerned & set(c.requirements)])


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_broken_rule_is_found_by_the_cases_about_it(mutant: Mutant, hub: ScriptedHub) -> None:
    suite = Suite(naive_member(mutant.kind()), hub)
    card = suite.run(chosen(mutant), [MemberRole(mutant.role_name)], jobs=8)
    failed = [result for result in card.results if result.outcome is CaseOutcome.FAILED]
    concerned = set(mutant.requirements.split())
    assert failed, "no case fails"
    others = [result for result in failed if not concerned & set(result.case.requirements)]
    assert [result.case.id for result in others] == [], "\n".join(report.problems(card))
    # Each of its requirements is found by a case that names it.
    named = {name for result in failed for name in result.case.requirements}
    assert concerned <= named
    assert report.blocked(card) == 0


def test_the_mutants_concern_requirements_of_cases() -> None:
    known = {name for case in CASES for name in case.requirements}
    for mutant in MUTANTS:
        assert set(mutant.requirements.split()) <= known, mutant.name
