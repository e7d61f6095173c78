"""Cases of lost links, and of members that leave or fail."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame import messages as m
from minerva_conformance.case import Break, CutLink, Interrupt, Tier
from minerva_conformance.cases.scripts import (
    ANY_DEVICE,
    END,
    GENERATOR,
    GREET,
    HOST,
    CaseGroup,
    delta_view,
    evolve,
    given,
    key_view,
    ticks,
)
from minerva_conformance.world import MEMBER, eAdd, eSplit

_case: Final = CaseGroup(tier=Tier.ROBUST).case
_LARGEST: Final = 1.7976931348623157e308


def _request(*events: object) -> m.EvolveRequest:
    return m.EvolveRequest(0, (MEMBER,), tuple(events))  # type: ignore[arg-type]


_LINKS: Final = (
    _case("link.cut", "joins again after its link was cut", "P6.16", CutLink(0), GREET, *END),
    _case(
        "link.cut twice", "joins again after each loss of its link", "P6.16",
        CutLink(0), CutLink(0), GREET, *END,
    ),
    _case(
        "link.ticks", "continues with its state after a lost link", "P6.12 P6.14",
        *ticks(0, 1, 2), CutLink(3), *ticks(3, 4), *END, roles=GENERATOR,
    ),
    _case(
        "link.same answer", "gives the same answer again after a lost link", "P6.13",
        *ticks(0, 1, 2), CutLink(2), *ticks(2, 3), *END, roles=GENERATOR,
    ),
    _case(
        "link.fragments", "discards its fragments after a lost link", "P6.15",
        given("ACounter#a", "ACounter#b"), evolve(0, eAdd(1.0)), CutLink(1),
        given("ACounter#b<total=5>"), evolve(1, eAdd(1.0)), roles=HOST,
    ),
    _case(
        "link.views", "accepts the key view after a lost link, whatever its sequence", "P10.10",
        key_view(5, 9, a=1.0), CutLink(6), key_view(6, 1, a=2.0), delta_view(7, 2, a=3.0), *END,
        roles=ANY_DEVICE,
    ),
)  # fmt: skip

_LEAVING: Final = (
    _case("leave.interrupted", "leaves or ends when it is asked to", "P6.21", Interrupt()),
    _case(
        "leave.in a frame", "leaves in the middle of a run", "P6.21", *ticks(0, 1), Interrupt(),
        roles=GENERATOR,
    ),
)  # fmt: skip

_FAILING: Final = (
    _case(
        "failed.real", "fails if a result is not finite", "P6.22",
        given(f"ACounter#a<total={_LARGEST!r}>"), Break(_request(eAdd(_LARGEST))), roles=HOST,
    ),
    _case(
        "failed.integer", "fails if a result has more than 64 bits", "P6.22",
        given(f"ACounter#a<births={2**63 - 1}>"), Break(_request(eSplit(1.0))), roles=HOST,
    ),
)  # fmt: skip

ENDING: Final = (*_LINKS, *_LEAVING, *_FAILING)
