"""Cases of generators: ticks, orders, readings and saved data."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.grammar.events import Events
from minerva_bus.wire.codec import encode
from minerva_bus.wire.plain import pack
from minerva_conformance.case import (
    Deliver,
    SendIgnored,
    StartAgain,
    Tier,
)
from minerva_conformance.cases.scripts import (
    END,
    GENERATOR,
    GREET,
    TICKED,
    CaseGroup,
    sights,
    tick,
    ticks,
)
from minerva_conformance.world import eAdd

_case: Final = CaseGroup(roles=GENERATOR).case


def _orders(frame: int, *amounts: float) -> Deliver:
    return Deliver(m.Orders(frame, tuple([eAdd(amount) for amount in amounts])))


_ALONE: Final = Deliver(m.Sources({"sight": ("eye",)}))
_PAIR: Final = Deliver(m.Sources({"sight": ("eye", "ear")}))
_WIDE_TICK: Final = b"\x92\xa4tick\xcf" + (3).to_bytes(8, "big")

_TICKS: Final = (
    _case("tick.first", "answers a tick", "P8.3 P7.3", tick(0), roles=TICKED),
    _case("tick.many", "answers each tick", "P8.3 P7.3", *ticks(*range(10)), roles=TICKED),
    _case(
        "tick.repeated", "repeats the answer to a repeated tick", "P7.5",
        tick(0), tick(0), tick(1), tick(1), tick(1), tick(2), roles=GENERATOR,
    ),
    _case("tick.to", "answers a tick on its own key", "P2.10 P8.3", tick(0, "to"), tick(1, "to")),
    _case("tick.gap", "answers ticks with frames between them", "P7.3", *ticks(0, 5, 6, 20)),
    _case("tick.later", "begins in a later frame", "P7.3 P6.12", *ticks(40, 41), frame=40),
    _case(
        "tick.report", "counts its ticks in the report", "P6.23", *ticks(0, 1, 2), *END,
    ),
    _case(
        "tick.greeted", "keeps its state when it is greeted again", "P6.6",
        tick(0), GREET, tick(1), GREET, tick(2), tier=Tier.ROBUST,
    ),
    _case(
        "tick.wide", "reads an integer in a wider encoding", "P3.1",
        Deliver(m.TickRequest(3), data=_WIDE_TICK), tier=Tier.EXACT, frame=3, roles=TICKED,
    ),
    *(
        _case(
            f"tick.frame {frame}", "repeats a large frame exactly", "P3.1 P7.3",
            tick(frame), tier=Tier.EXACT, frame=frame, roles=TICKED,
        )
        for frame in ((1 << 31) + 1, (1 << 53) + 1, (1 << 62) + 1)
    ),
    _case(
        "tick.other keys", "does not subscribe to requests for hosts", "P2.4",
        SendIgnored("evolve", encode(m.TickRequest(0))), tick(0), roles=GENERATOR,
        tier=Tier.ROBUST,
    ),
)  # fmt: skip

_SAVED: Final = (
    _case(
        "saved.restart", "continues with the data that its predecessor saved", "P8.4 P8.5",
        *ticks(0, 1, 2), StartAgain(3), *ticks(3, 4),
    ),
    _case(
        "saved.same frame", "answers the frame in progress after a restart", "P8.4 P8.5",
        *ticks(0, 1), StartAgain(2), tick(2), StartAgain(3), tick(3), *END,
    ),
    _case(
        "saved.first", "begins in its initial state without saved data", "P8.4",
        StartAgain(0), *ticks(0, 1),
    ),
)  # fmt: skip

_ORDERS: Final = (
    _case(
        "orders.passed on", "passes orders on in the tick of their frame", "P7.1 P8.3",
        _orders(0, 9.0), tick(0), tick(1), requires="orders",
    ),
    _case(
        "orders.several", "keeps the order of orders", "P7.1",
        _orders(0, 9.0, 3.0, 5.0), tick(0), requires="orders",
    ),
    _case(
        "orders.next", "passes orders on in their own frames", "P7.1",
        _orders(0, 1.5), tick(0), _orders(1, 2.5), tick(1), tick(2), requires="orders",
    ),
    _case(
        "orders.repeated tick", "repeats orders with the answer to a repeated tick", "P7.5",
        _orders(0, 9.0), tick(0), tick(0), tick(1), requires="orders",
    ),
    _case(
        "orders.parts", "keeps condition and receivers of an event", "P3.10 P3.13 P3.14",
        Deliver(m.Orders(0, (eAdd(1.0, condition='total < 5 and name != "é"',
                                  receivers=("a", "b:1")),))),
        tick(0), requires="orders", tier=Tier.EXACT,
    ),
    *(
        _case(
            f"orders.real {number!r}", "keeps every bit of a real", "P3.1 P5.4",
            _orders(0, number), tick(0), requires="orders", tier=Tier.EXACT,
        )
        for number in (-0.0, 5e-324, 0.1, 1.7976931348623157e308, 9007199254740993.0, 2.0)
    ),
    _case(
        "orders.integer", "accepts an integer for a real", "P4.1",
        Deliver(
            m.Orders(0, (eAdd(7.0),)), data=pack(["orders", 0, [["eAdd", [7]]]]),
        ),
        tick(0), requires="orders", tier=Tier.EXACT,
    ),
    _case(
        "orders.columns", "reads orders in columns", "P3.19",
        Deliver(m.Orders(0, (Events.repeated(eAdd(2.5), 3),))), tick(0),
        requires="orders columns", tier=Tier.EXACT,
    ),
)  # fmt: skip

_READINGS: Final = (
    _case(
        "readings.wait", "answers a tick after the readings of its frame", "P11.4",
        _ALONE, tick(0), sights("eye", 0, 2.5), tick(1), sights("eye", 1, 3.5, 4.5),
        requires="topics",
    ),
    _case(
        "readings.before", "keeps readings that arrive before the tick", "P11.4",
        _ALONE, sights("eye", 0, 2.5), tick(0), sights("eye", 1, 3.5), tick(1), requires="topics",
    ),
    _case(
        "readings.empty", "counts a publication without readings", "P11.2 P11.4",
        _ALONE, tick(0), sights("eye", 0), tick(1), sights("eye", 1, 2.0), requires="topics",
    ),
    _case(
        "readings.two", "waits for every publisher", "P11.4",
        _PAIR, tick(0), sights("ear", 0, 1.0), sights("eye", 0, 2.0), requires="topics",
    ),
    _case(
        "readings.order", "processes readings in the order of their publishers", "P11.6",
        _PAIR, sights("eye", 0, 2.0), sights("ear", 0, 1.0), tick(0), tick(1),
        sights("eye", 1, 4.0), sights("ear", 1, 3.0), requires="topics", tier=Tier.EXACT,
    ),
    _case(
        "readings.repeated", "repeats an answer with its readings", "P7.5 P11.4",
        _ALONE, tick(0), sights("eye", 0, 2.5), tick(0), tick(1), sights("eye", 1, 0.5),
        requires="topics",
    ),
    _case(
        "readings.free", "uses readings of a free-running publisher once", "P11.3 P11.5",
        sights("gauge", -1, 2.5), tick(0), tick(1), requires="topics",
    ),
    _case(
        "readings.all", "receives the publishers on the key of all members", "P2.4 P11.4",
        Deliver(m.Sources({"sight": ("eye",)}), "all"), tick(0), sights("eye", 0, 2.5),
        requires="topics",
    ),
    _case(
        "readings.no source", "does not wait once a publisher has gone", "P11.4",
        _ALONE, tick(0), sights("eye", 0, 2.5), Deliver(m.Sources({})), tick(1), requires="topics",
    ),
    _case(
        "readings.released", "answers when the missing publisher has gone", "P11.4",
        _ALONE, tick(0), Deliver(m.Sources({})), tick(1), requires="topics",
        tier=Tier.ROBUST,
    ),
    _case(
        "readings.other topics", "does not wait for topics to which it does not subscribe",
        "P11.4", Deliver(m.Sources({"scan": ("eye",)})), tick(0), requires="topics",
        tier=Tier.ROBUST,
    ),
    _case(
        "readings.text", "reads names in Unicode", "P3.2",
        _ALONE, tick(0), sights("eye", 0, 2.5, marker="cuisine é 𝄞"), requires="topics",
        tier=Tier.EXACT,
    ),
    _case(
        "readings.garbage", "drops readings that cannot be read", "P14.4",
        _ALONE, tick(0), SendIgnored("topic/sight/eye", b"\xc1", epoch=None),
        SendIgnored("topic/sight/eye", pack(["readings", 0]), epoch=None),
        sights("eye", 0, 2.5), requires="topics", tier=Tier.ROBUST,
    ),
    _case(
        "readings.unknown", "drops readings of an unknown kind", "P14.4",
        _ALONE, tick(0),
        SendIgnored("topic/sight/eye", pack(["readings", 0, [["smell", "r1", 0.0]]]), epoch=None),
        sights("eye", 0, 2.5), requires="topics", tier=Tier.ROBUST,
    ),
    _case(
        "publish.each", "publishes once for each tick", "P11.2",
        *ticks(0, 1, 2), requires="publishes",
    ),
    _case(
        "publish.repeat", "publishes the last readings again", "P11.7",
        *ticks(0, 1), Deliver(m.Repeat("echo")), tick(2), requires="publishes",
    ),
    _case(
        "publish.nothing yet", "publishes nothing again before the first tick", "P11.7",
        Deliver(m.Repeat("echo")), tick(0), requires="publishes",
    ),
    _case(
        "publish.other", "does not publish a topic that it lacks", "P11.7",
        tick(0), Deliver(m.Repeat("scan")), tick(1), requires="publishes", tier=Tier.ROBUST,
    ),
)  # fmt: skip

GENERATORS: Final = (*_TICKS, *_SAVED, *_ORDERS, *_READINGS)
