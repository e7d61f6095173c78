"""A member that breaks one rule fails the cases about this rule, and (slow) no others."""

from collections.abc import Iterable, Iterator
from typing import Any

import pytest
from mutants import MUTANTS, Mutant
from naive import Host
from threads import naive_member

from minerva_conformance import report
from minerva_conformance.case import Case, CaseOutcome, CaseResult
from minerva_conformance.cases import CASES
from minerva_conformance.scripted_world import ScriptedHub
from minerva_conformance.suite import Suite, select
from minerva_conformance.world import MemberRole

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


def failures(mutant: Mutant, hub: ScriptedHub, cases: Iterable[Case]) -> list[CaseResult]:
    """The failed results of a broken member; no case may be blocked."""
    suite = Suite(naive_member(mutant.kind()), hub)
    card = suite.run(cases, [MemberRole(mutant.role_name)], jobs=8)
    assert report.blocked(card) == 0, "\n".join(report.problems(card))
    return [result for result in card.results if result.outcome is CaseOutcome.FAILED]


def concerns(mutant: Mutant, case: Case) -> bool:
    return not set(mutant.requirements.split()).isdisjoint(case.requirements)


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_broken_rule_is_found_by_the_cases_about_it(mutant: Mutant, hub: ScriptedHub) -> None:
    about = [case for case in chosen(mutant) if concerns(mutant, case)]
    named = {name for failed in failures(mutant, hub, about) for name in failed.case.requirements}
    # Each of its requirements is found by a case that names it.
    assert set(mutant.requirements.split()) <= named


@pytest.mark.slow
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_broken_rule_fails_no_cases_about_others(mutant: Mutant, hub: ScriptedHub) -> None:
    others = [case for case in chosen(mutant) if not concerns(mutant, case)]
    assert [failed.case.id for failed in failures(mutant, hub, others)] == []


def test_a_host_need_not_know_each_policy(hub: ScriptedHub) -> None:
    def welcome(self: Host, welcome: dict[str, Any], again: bool) -> None:
        if welcome["policy"] != "sequential":
            raise ValueError(welcome["policy"])
        Host.welcome(self, welcome, again)

    limited = naive_member(Mutant("knows one policy", Host, "P9.32", {"welcome": welcome}).kind())
    cases = select(("literal.add", "evolve.add"), (MemberRole.HOST,))
    card = Suite(limited, hub).run(cases, [MemberRole.HOST])
    assert {result.case.id: (result.outcome, result.problem) for result in card.results} == {
        "literal.add": (CaseOutcome.NOT_APPLICABLE, "it does not know the policy literal"),
        "evolve.add": (CaseOutcome.PASSED, ""),
    }


def test_the_mutants_concern_requirements_of_cases() -> None:
    known = {name for case in CASES for name in case.requirements}
    for mutant in MUTANTS:
        assert set(mutant.requirements.split()) <= known, mutant.name
