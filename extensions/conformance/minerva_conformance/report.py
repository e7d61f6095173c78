"""Score cards as text, JSON and JUnit XML."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, tostring

from minerva_bus.wording import xml_characters
from minerva_conformance.case import Case, CaseOutcome, CaseResult, Tier
from minerva_conformance.suite import ScoreCard

_SHOWN_LINES: Final = 12
"""Messages of a failed case that a text shows: the last ones."""
_COUNTED: Final = (CaseOutcome.PASSED, CaseOutcome.FAILED, CaseOutcome.BLOCKED)


def rows(card: ScoreCard) -> list[Sequence[str]]:
    """The table of tiers: cases by outcome."""
    head = ["tier", *(outcome.value for outcome in CaseOutcome)]
    lines = [
        [tier.value, *(str(card.count(tier, outcome)) for outcome in CaseOutcome)] for tier in Tier
    ]
    return [head, *lines]


def problems(card: ScoreCard) -> Iterator[str]:
    """Each case that failed, with what was sent, expected and received."""
    for result in card.results:
        if result.outcome is CaseOutcome.FAILED:
            yield "\n".join(_lines(result))


def _lines(result: CaseResult) -> Iterator[str]:
    case = result.case
    yield f"{case.id} ({result.role}, {' '.join(case.requirements)}): {case.title}"
    for part in result.problem.splitlines()[:_SHOWN_LINES]:
        yield f"  {part}"
    for name, texts in (
        ("sent", result.sent[-_SHOWN_LINES:]),
        ("expected", result.expected),
        ("received", result.received),
    ):
        for text in texts:
            yield f"  {name:9} {text}"[:400]


def blocked(card: ScoreCard) -> int:
    """Number of cases that could not begin."""
    return sum(result.outcome is CaseOutcome.BLOCKED for result in card.results)


def as_json(card: ScoreCard) -> Mapping[str, Any]:
    """The score card as plain data."""
    return {
        "roles": [role.value for role in card.roles],
        "reached": card.reached.value if card.reached is not None else None,
        "passed": card.passed,
        "tiers": {
            tier.value: {outcome.value: card.count(tier, outcome) for outcome in CaseOutcome}
            for tier in Tier
        },
        "cases": [
            {
                **described(result.case),
                "role": result.role.value,
                "outcome": result.outcome.value,
                "problem": result.problem,
                "sent": list(result.sent),
                "expected": list(result.expected),
                "received": list(result.received),
            }
            for result in card.results
        ],
    }


def described(case: Case) -> dict[str, Any]:
    """A case without its steps, as plain data."""
    return {
        "id": case.id,
        "title": case.title,
        "requirements": list(case.requirements),
        "tier": case.tier.value,
        "roles": [role.value for role in case.roles],
        "requires": sorted(case.requires),
    }


def listed(cases: Iterable[Case]) -> list[Sequence[str]]:
    """A table of cases."""
    lines = [
        [case.id, case.tier.value, " ".join(case.roles), " ".join(case.requirements), case.title]
        for case in cases
    ]
    return [["case", "tier", "roles", "requirements", "the member"], *lines]


def as_junit(card: ScoreCard) -> str:
    """The score card as JUnit XML: one suite for each role."""
    suites = Element("testsuites", name="minerva conformance")
    for role in card.roles:
        results = [result for result in card.results if result.role is role]
        suite = SubElement(suites, "testsuite", name=role.value, tests=str(len(results)))
        for outcome, attribute in zip(_COUNTED[1:], ("failures", "errors"), strict=True):
            suite.set(attribute, str(sum(result.outcome is outcome for result in results)))
        for result in results:
            _add(suite, result)
    return tostring(suites, encoding="unicode", xml_declaration=True)


def _add(suite: Element, result: CaseResult) -> None:
    case = SubElement(
        suite, "testcase", name=result.case.id, classname=f"{result.role}.{result.case.tier}"
    )
    elements = {
        CaseOutcome.FAILED: "failure",
        CaseOutcome.BLOCKED: "error",
        CaseOutcome.NOT_APPLICABLE: "skipped",
    }
    if result.outcome in elements:
        text = xml_characters("\n".join(_lines(result)))
        message = xml_characters(result.problem.split("\n", 1)[0])
        SubElement(case, elements[result.outcome], message=message).text = text
