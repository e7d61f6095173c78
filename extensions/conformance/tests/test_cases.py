"""The cases of the conformance suite as data: names, requirements and coverage."""

import re

import pytest

from minerva_bus.errors import MisuseError
from minerva_conformance import parameters
from minerva_conformance.case import Tier
from minerva_conformance.cases import CASES
from minerva_conformance.suite import select
from minerva_conformance.world import MemberRole
from tools.protocol_tables import protocol

REQUIREMENTS = set(re.findall(r"\[(P\d+\.\d+)\]", protocol()))

NO_CASE = {
    "the coordinator's": "P1.1 P2.8 P2.9 P6.9 P6.20 P7.2 P7.4 P9.11 P9.31 P12.1 P13.1 P13.2"
    " P14.1 P14.2 P14.3 P14.5 P15.1",
    "of every case: the suite cannot start a member otherwise": "P1.2 P1.3 P1.4 P6.1 P6.4",
    "not visible to the coordinator": "P1.5 P1.7 P4.2 P6.18 P10.8 P10.9",
    "in protocol/vectors": "P3.3 P3.4 P3.5 P3.6 P3.7 P3.9 P3.12 P3.15 P3.16 P3.21 P5.1 P5.2"
    " P5.3 P9.28 P9.29 P11.1",
    "of names that the suite does not choose": "P2.1 P2.2 P2.3",
    "of members that count as gone": "P15.2",
    "of versions": "P16.3",
    "of generators that the suite does not play": "P7.10 P7.11 P9.33",
    "takes ten seconds": "P6.8",
    "of another run": "P6.19",
    "permissions": "P9.20 P9.23",
}
"""Requirements without a case, by the reason."""


def test_there_are_many_cases_with_unique_names() -> None:
    names = [case.id for case in CASES]
    assert len(names) >= 200
    assert len(set(names)) == len(names)


def test_the_cases_name_requirements_of_the_protocol() -> None:
    for case in CASES:
        assert case.requirements, case.id
        assert set(case.requirements) <= REQUIREMENTS, case.id


def test_every_requirement_has_a_case_or_a_reason() -> None:
    checked = {name for case in CASES for name in case.requirements}
    excused = [name for names in NO_CASE.values() for name in names.split()]
    shown = {name for name in excused if name not in REQUIREMENTS}
    assert not shown, "no requirement of PROTOCOL.md"
    assert sorted(REQUIREMENTS - checked - set(excused)) == []
    assert sorted(checked & set(excused)) == [], "remove from NO_CASE"


@pytest.mark.parametrize("role", MemberRole)
def test_every_role_has_cases_of_every_tier(role: MemberRole) -> None:
    assert {case.tier for case in select((), (role,))} == set(Tier)


def test_a_name_selects_a_case_or_a_group() -> None:
    assert [case.id for case in select(["tick.first"])] == ["tick.first"]
    assert {case.id.split(".")[0] for case in select(["tick", "death"])} == {"tick", "death"}
    with pytest.raises(MisuseError, match=r"did you mean 'tick\.first'|tick"):
        select(["tick.frist"])


def test_parameters_are_the_cases_of_a_role() -> None:
    pairs = list(parameters("host", "observer"))
    assert {role for _, role in pairs} == {MemberRole.HOST, MemberRole.OBSERVER}
    assert all(role in case.roles for case, role in pairs)
