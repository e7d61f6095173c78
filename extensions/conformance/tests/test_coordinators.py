"""The suite for coordinators: passed by Minerva Bus, and not by a program that does nothing."""

import sys
from pathlib import Path

import pytest
from test_cases import REQUIREMENTS

from minerva_bus.errors import MisuseError
from minerva_conformance import coordinating, report
from minerva_conformance.case import CaseOutcome, CoordinatorRole, Tier
from minerva_conformance.cases.coordinators import COORDINATORS
from minerva_conformance.coordinator_suite import (
    is_coordinator,
    run_coordinator_suite,
    select_scripts,
)

OWN = [sys.executable, "-m", "minerva_conformance.coordinator"]


@pytest.fixture(autouse=True)
def runtime_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))


# All cases, with a new process for each that ends one: more than a minute on a busy machine.
@pytest.mark.timeout(600)
def test_the_coordinator_of_minerva_bus_passes() -> None:
    card = run_coordinator_suite(OWN)
    assert "\n".join(report.problems(card)) == ""
    assert [r.case.id for r in card.results if r.outcome is not CaseOutcome.PASSED] == []
    assert card.roles == (CoordinatorRole.COORDINATOR,)
    assert card.reached is Tier.ROBUST


def test_a_program_that_is_no_coordinator_is_blocked() -> None:
    card = run_coordinator_suite([sys.executable, "-c", "pass"], cases=["greet", "ticks"])
    assert [result.outcome for result in card.results] == [CaseOutcome.BLOCKED] * 2
    assert "no coordinator of" in card.results[0].problem


def test_a_coordinator_of_another_version_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen from the suite: members whose hello this coordinator refuses."""
    genuine = coordinating.hello
    monkeypatch.setattr(coordinating, "hello", lambda role, **keys: genuine(role, version=5))
    card = run_coordinator_suite(OWN, cases=["greet", "welcome", "late"])
    outcomes = {result.case.id: result.outcome for result in card.results}
    assert outcomes == {
        "coordinator.greet": CaseOutcome.PASSED,
        "coordinator.welcome": CaseOutcome.FAILED,
        "coordinator.late": CaseOutcome.FAILED,
    }


def test_the_cases_name_requirements_of_the_protocol() -> None:
    names = [script.case.id for script in COORDINATORS]
    assert len(set(names)) == len(names) >= 50
    for script in COORDINATORS:
        assert script.case.requirements
        assert set(script.case.requirements) <= REQUIREMENTS, script.case.id


def test_names_and_roles() -> None:
    assert [script.case.id for script in select_scripts(["ticks"])] == ["coordinator.ticks"]
    assert len(select_scripts(["garbage"])) > 10
    with pytest.raises(MisuseError, match="there is no case"):
        select_scripts(["tocks"])
    assert is_coordinator(["coordinator"])
    assert not is_coordinator(["host"])
    with pytest.raises(MisuseError, match="separate runs"):
        is_coordinator(["host", "coordinator"])
