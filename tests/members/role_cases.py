"""The cases of the conformance suite for each role of a program that takes several roles.

Each case starts a process. Half of the cases are common to all roles, such as those about joining
and garbage. A program handles them by the same code in every role, so they are played in its first
role, and in all others on demand.
"""

from collections.abc import Sequence
from typing import Any

import pytest

from minerva_bus.testing.conformance.suite import select
from minerva_bus.testing.conformance.world import MemberRole


def role_cases(roles: Sequence[MemberRole]) -> list[Any]:
    """Parameters of a test: a role, and the names of its cases that no role before it has."""
    played: set[str] = set()
    parameters: list[Any] = []
    for role in roles:
        names = [case.id for case in select((), (role,))]
        new = [name for name in names if name not in played]
        parameters.append(pytest.param(role, new, id=role.value))
        if len(new) < len(names):
            every = pytest.param(role, names, id=f"{role.value}-all", marks=pytest.mark.slow)
            parameters.append(every)
        played.update(names)
    return parameters
