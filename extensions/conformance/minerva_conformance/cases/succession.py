"""Cases of a coordinator that vanishes and is succeeded by another one."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.wire.codec import encode
from minerva_conformance.case import (
    Deliver,
    Disappear,
    Enter,
    Reappear,
    SendIgnored,
    Tier,
)
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
    sights,
    tick,
    ticks,
)
from minerva_conformance.world import eAdd

_case: Final = CaseGroup("succession.", tier=Tier.ROBUST).case


_STALE_TICK: Final = SendIgnored("tick", encode(m.TickRequest(1)), checked=False)
_STALE_STOP: Final = SendIgnored("all", encode(m.Stop("the old one")), epoch=-1, checked=False)

SUCCESSION: Final = (
    _case("undeclares", "undeclares its token without a coordinator", "P6.16", Disappear()),
    _case(
        "returns", "declares its token for a successor", "P6.11 P6.17 P6.12",
        Disappear(), Reappear(0), GREET, *END,
    ),
    _case(
        "same epoch", "joins the same coordinator again after a lost link", "P6.16 P6.17",
        Disappear(), Reappear(0, later=0), GREET, *END,
    ),
    _case(
        "between", "ignores the coordinator that it has lost", "P6.16 P2.7",
        tick(0), Disappear(), _STALE_TICK, Reappear(1), tick(1), roles=GENERATOR,
    ),
    _case(
        "twice", "survives two successions", "P6.11 P6.17",
        Disappear(), Reappear(0), Disappear(), Reappear(0), GREET, *END,
    ),
    _case(
        "old stop", "ignores the predecessor after a succession", "P2.7",
        Disappear(), Reappear(0), _STALE_STOP, GREET, *END,
    ),
    _case(
        "ticks", "continues with the frame of its welcome", "P6.12 P6.14",
        *ticks(0, 1, 2), Disappear(), Reappear(3), *ticks(3, 4), *END, roles=GENERATOR,
    ),
    _case(
        "same answer", "gives the same answer again in the frame in progress", "P6.13",
        *ticks(0, 1, 2), Disappear(), Reappear(2), *ticks(2, 3), *END, roles=GENERATOR,
    ),
    _case(
        "same readings", "publishes the same readings again", "P6.13",
        *ticks(0, 1), Disappear(), Reappear(1), tick(1), tick(2), roles=GENERATOR,
        requires="publishes",
    ),
    _case(
        "readings", "discards readings from before a succession", "P6.12 P11.4",
        Deliver(m.Sources({"sight": ("eye",)})), tick(0), sights("eye", 0, 1.0),
        sights("eye", 1, 9.0), Disappear(), Reappear(1),
        Deliver(m.Sources({"sight": ("eye",)})), tick(1), sights("eye", 1, 2.0),
        roles=GENERATOR, requires="topics",
    ),
    _case(
        "unanswered", "answers the successor's tick instead of its predecessor's",
        "P6.12 P6.14 P11.4",
        tick(0), Deliver(m.Sources({"sight": ("ear", "eye")})), tick(1), Disappear(),
        # The successor learns of the publishers one by one.
        Reappear(None), Deliver(m.Sources({"sight": ("eye",)})), sights("eye", 1, 2.0),
        Enter(1), Deliver(m.Sources({"sight": ("eye",)})), sights("eye", 1, 2.0), tick(1),
        roles=GENERATOR, requires="topics",
    ),
    _case(
        "fragments", "discards its fragments", "P6.15",
        given("ACounter#a", "ACounter#b"), evolve(0, eAdd(1.0)), Disappear(), Reappear(1),
        given("ACounter#b<total=5>"), evolve(1, eAdd(1.0)), roles=HOST,
    ),
    _case(
        "evolves again", "evolves the frame in progress again", "P6.15 P7.6",
        given("ACounter#a"), evolve(0, eAdd(1.0)), Disappear(), Reappear(0),
        given("ACounter#a"), evolve(0, eAdd(1.0)), evolve(1, eAdd(1.0)), roles=HOST,
    ),
    _case(
        "views", "accepts the key view of a successor, whatever its sequence", "P10.10",
        key_view(5, 9, a=1.0), Disappear(), Reappear(6), key_view(6, 1, a=2.0),
        delta_view(7, 2, a=3.0), *END, roles=ANY_DEVICE,
    ),
)  # fmt: skip
