"""Checks whether a member, in any language, follows PROTOCOL.md.

The suite starts the member for each case, plays the coordinator over Zenoh, and compares the
member's answers with those of the reference, the protocol side of the Python members.

    from minerva_conformance import check_case, parameters

    @pytest.mark.parametrize(("case", "role"), parameters("generator"), ids=str)
    def test_generator(case, role):
        check_case(case, role, ["node", "generator.js"])
"""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_conformance.case import Case, CaseOutcome, CaseResult, Tier
    from minerva_conformance.suite import ScoreCard, check_case, parameters, run_suite
    from minerva_conformance.world import MemberRole

__getattr__ = imported_at_first_use(
    __name__,
    {
        "case": "Case CaseOutcome CaseResult Tier",
        "suite": "ScoreCard check_case parameters run_suite",
        "world": "MemberRole",
    },
)

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
