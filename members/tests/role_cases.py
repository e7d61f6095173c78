"""The cases of the conformance suite for each role of a program that takes several roles.

Each case starts a process. Half of the cases are common to all roles, such as those about joining
and garbage. A program handles them by the same code in every role, so they are played in its first
role, and in all others on demand.

Of the cases about exact values and garbage, a member whose values are compared with the vectors may
play a part, and all on demand: Java and JavaScript play an eighth, because their virtual machines
take up to half a second to start. A case that a member in each language has failed is always
played.
"""

from collections.abc import Sequence
from typing import Any

import pytest

from minerva_conformance.case import Tier
from minerva_conformance.suite import select
from minerva_conformance.world import MemberRole

FAILED_ONCE = ("succession.unanswered",)


def role_cases(roles: Sequence[MemberRole], part: int = 1) -> list[Any]:
    """Parameters of a test: a role, and the names of its cases that no role before it has.

    Of those about exact values and garbage, each `part`-th one.
    """
    played: set[str] = set()
    parameters: list[Any] = []
    for role in roles:
        cases = select((), (role,))
        new = [case for case in cases if case.id not in played]
        thinned = [case for case in new if case.tier in (Tier.EXACT, Tier.ROBUST)]
        left_out = {case.id for n, case in enumerate(thinned) if n % part}.difference(FAILED_ONCE)
        names = [case.id for case in new if case.id not in left_out]
        parameters.append(pytest.param(role, names, id=role.value))
        every = [case.id for case in cases]
        if len(names) < len(every):
            mark = pytest.mark.slow
            parameters.append(pytest.param(role, every, id=f"{role.value}-all", marks=mark))
        played.update(every)
    return parameters
