"""Cases of joining, of the end, and of epochs: for every role."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.wire.codec import encode
from minerva_conformance.case import (
    AwaitEnd,
    Deliver,
    Disappear,
    Enter,
    SendIgnored,
    Succeed,
    Tier,
)
from minerva_conformance.cases.scripts import (
    ANY_DEVICE,
    END,
    GENERATOR,
    GREET,
    HOST,
    STOP,
    TICKED,
    CaseGroup,
    evolve,
    given,
    key_view,
    tick,
)
from minerva_conformance.world import DT, MEMBER, SEED, VOCABULARY, eAdd

_case: Final = CaseGroup("join.", tier=Tier.JOINS, joined=False).case


_TICK: Final = encode(m.TickRequest(0))
_EVOLVE: Final = encode(m.EvolveRequest(0, (MEMBER,)))
_OTHER_POLICY: Final = m.Welcome("world", VOCABULARY, SEED, DT, 0, "newest")

JOINING: Final = (
    _case("token", "declares its token", "P6.5"),
    _case("hello", "answers a greeting with its hello", "P6.6 P8.1 P8.2 P16.1", GREET),
    _case("subscribed", "receives everything from its token on", "P6.3 P6.5", GREET, GREET),
    _case("again", "answers each greeting", "P6.6", GREET, GREET, GREET),
    _case("welcome", "takes part after its welcome", "P6.6 P6.7", GREET, Enter(), GREET, *END),
    _case(
        "more", "ignores keys of a vocabulary that it does not know", "P16.2 P4.3",
        GREET, Enter(more=True), GREET, *END,
    ),
    _case(
        "name", "ends if another member has its name", "P6.2", name_taken=True,
        tier=Tier.ROBUST,
    ),
    _case(
        "refused", "ends with an exit code other than 0 if it is refused", "P6.10",
        GREET, Deliver(m.Refused("another version")), AwaitEnd(failed=True),
    ),
    _case(
        "expelled", "ends if it is refused later", "P6.10",
        Deliver(m.Refused("a violation")), AwaitEnd(failed=True), joined=True,
    ),
    _case(
        "policy", "takes no part under a policy that it does not know", "P9.32",
        GREET, Deliver(_OTHER_POLICY), AwaitEnd(failed=True), roles=HOST,
    ),
    _case("stop", "answers stop with its report, and ends", "P6.23", *END, joined=True),
    _case(
        "stop to", "ends on a stop for it alone", "P6.23 P2.4",
        Deliver(m.Stop("the world has ended"), "to"), AwaitEnd(), joined=True,
    ),
    _case(
        "stop text", "reads a reason in Unicode", "P6.23 P3.2",
        Deliver(m.Stop("le monde s'est arrêté 𝄞")), AwaitEnd(), joined=True,
    ),
    _case("stop early", "ends on a stop before its welcome", "P6.7 P6.23", GREET, *END),
    _case(
        "gone", "ends if the coordinator does not return", "P6.24 P6.11",
        Disappear(), AwaitEnd(failed=None), joined=True, tier=Tier.ROBUST,
    ),
    _case(
        "early tick", "ignores a tick before its welcome", "P6.7",
        GREET, SendIgnored("tick", _TICK), SendIgnored(f"to/{MEMBER}", _TICK), Enter(), GREET,
        *END, roles=TICKED,
    ),
    _case(
        "early evolve", "ignores a request before its welcome", "P6.7",
        GREET, SendIgnored("evolve", _EVOLVE), Enter(), given("ACounter#a"),
        evolve(0, eAdd(1.0)), roles=HOST,
    ),
    _case(
        "early view", "ignores a view before its welcome", "P6.7",
        GREET, SendIgnored(f"to/{MEMBER}", encode(m.ViewShown("eShow", 0, 4, {}))), Enter(),
        key_view(1, 4, a=1.0), *END, roles=ANY_DEVICE,
    ),
    _case(
        "early garbage", "ignores bytes that are not a message before its welcome", "P14.4",
        GREET, SendIgnored("all", b"\xc1"), SendIgnored(f"to/{MEMBER}", b"\xc1"), Enter(), GREET,
        *END, tier=Tier.ROBUST,
    ),
    _case(
        "older greeting", "ignores a coordinator of an older epoch", "P2.6 P2.7",
        GREET, SendIgnored(f"to/{MEMBER}", encode(m.Greet()), epoch=-1), GREET, *END,
        tier=Tier.ROBUST,
    ),
    _case(
        "older stop", "ignores the stop of an older epoch", "P2.7",
        SendIgnored("all", encode(m.Stop("an older coordinator")), epoch=-1), GREET, *END,
        joined=True, tier=Tier.ROBUST,
    ),
    _case(
        "older tick", "ignores the tick of an older epoch", "P2.7",
        SendIgnored("tick", _TICK, epoch=-1), tick(0), roles=GENERATOR, joined=True,
        tier=Tier.ROBUST,
    ),
    _case(
        "later tick", "obeys a later epoch only after its greeting", "P2.6",
        SendIgnored("tick", _TICK, epoch=1), tick(0), roles=GENERATOR, joined=True,
        tier=Tier.ROBUST,
    ),
    _case(
        "older evolve", "ignores the request of an older epoch", "P2.7",
        given("ACounter#a"), SendIgnored("evolve", _EVOLVE, epoch=-1), evolve(0, eAdd(1.0)),
        roles=HOST, joined=True, tier=Tier.ROBUST,
    ),
    _case(
        "later greeting", "obeys the coordinator with the highest epoch", "P2.6",
        Succeed(), GREET, Enter(), GREET, *END, joined=True, tier=Tier.ROBUST,
    ),
    _case(
        "replaced", "ignores a coordinator that has been replaced", "P2.6 P2.7",
        Succeed(), GREET, Enter(), SendIgnored("all", encode(m.Stop("replaced")), epoch=-1),
        GREET, *END, joined=True, tier=Tier.ROBUST,
    ),
    _case(
        "later stop", "obeys the stop of a later epoch", "P2.6",
        Succeed(), STOP, AwaitEnd(), joined=True, tier=Tier.ROBUST,
    ),
    _case(
        "large epoch", "puts an epoch of 64 bits before its messages", "P2.5 P2.6",
        *[Succeed()] * 130, GREET, Enter(), GREET, *END, joined=True, tier=Tier.EXACT,
    ),
)  # fmt: skip
