"""Checks whether a member, in any language, follows PROTOCOL.md.

The suite starts the member for each case, plays the coordinator over Zenoh, and compares the
member's answers with those of the reference, the protocol side of the Python members.

    from minerva_bus.testing.conformance import check_case, parameters

    @pytest.mark.parametrize(("case", "role"), parameters("generator"), ids=str)
    def test_generator(case, role):
        check_case(case, role, ["node", "generator.js"])
"""

from minerva_bus.testing.conformance.case import Case, CaseOutcome, CaseResult, Tier
from minerva_bus.testing.conformance.suite import ScoreCard, check_case, parameters, run_suite
from minerva_bus.testing.conformance.world import MemberRole

__all__ = [
    "Case",
    "CaseOutcome",
    "CaseResult",
    "MemberRole",
    "ScoreCard",
    "Tier",
    "check_case",
    "parameters",
    "run_suite",
]
