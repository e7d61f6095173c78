"""Cases of hosts: fragments, evolution, births, emitted events, views and populations."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.grammar.events import Event, Events
from minerva_bus.wire.codec import encode
from minerva_bus.wire.plain import pack
from minerva_conformance.case import Case, Deliver, SendIgnored, Step, Tier
from minerva_conformance.cases.scripts import (
    END,
    GREET,
    HOST,
    PART,
    CaseGroup,
    evolve,
    given,
    numbered,
    population,
)
from minerva_conformance.world import (
    MEMBER,
    VOCABULARY,
    eAdd,
    eCall,
    eDraw,
    eEnd,
    eMaybe,
    eName,
    eSplit,
)

_case: Final = CaseGroup(roles=HOST).case


def _exact(name: str, title: str, requirements: str, *steps: Step, requires: str = "") -> Case:
    return _case(name, title, requirements, *steps, tier=Tier.EXACT, requires=requires)


def _literal(name: str, title: str, *steps: Step, more: str = "") -> Case:
    return _case(
        f"literal.{name}",
        title,
        f"P9.14 {more}",
        *steps,
        tier=Tier.EXACT,
        policy="literal",
        frame=3,
    )


_A: Final = given("ACounter#a")
_AB: Final = given("ACounter#a<total=1>", 'ACounter#b<total=10, name="é">')
_OTHERS: Final = m.EvolveRequest(0, ("other", "third"), (eAdd(1.0),))

_EVOLVING: Final = (
    _case("evolve.nothing", "answers a request that changes nothing", "P9.4 P7.3", _A, evolve(0)),
    _case("evolve.add", "evolves its fragments", "P9.6 P9.7", _AB, evolve(0, eAdd(2.5))),
    _case(
        "evolve.frames", "keeps the fragments that it has evolved", "P9.8",
        _AB, evolve(0, eAdd(2.5)), evolve(1, eAdd(0.5)), evolve(7, eAdd(1.0)),
    ),
    _case(
        "evolve.several", "processes several events one after another", "P9.6 P9.12",
        _A, evolve(0, eAdd(2.0), eName("x"), eAdd(0.25), eName("y")),
    ),
    _case(
        "evolve.unchanged", "leaves out what has not changed", "P9.7",
        _AB, evolve(0, eAdd(0.0)), evolve(1, eName("é")), evolve(2, eName("é")),
    ),
    _case(
        "evolve.receivers", "evolves only the receivers of an event", "P9.6",
        _AB, evolve(0, eAdd(2.0, receivers=("b",))), evolve(1, eAdd(3.0, receivers=("a", "b"))),
        evolve(2, eAdd(3.0, receivers=("c",))),
    ),
    _case(
        "evolve.sender", "does not exclude the sender of an event", "P9.6 P3.11",
        _AB, evolve(0, eAdd(2.0, sender="a")),
    ),
    _case(
        "evolve.others", "ignores a request for other hosts", "P9.3",
        _A, SendIgnored("evolve", encode(_OTHERS)), evolve(0, eAdd(1.0)),
    ),
    _case(
        "evolve.only", "evolves only the fragments that a request names", "P9.5",
        _AB, evolve(0, eAdd(1.0), only=("b",)), evolve(1, eAdd(1.0), only=("a", "b")),
        evolve(2, eAdd(1.0), only=("a",)),
    ),
    _case(
        "evolve.to", "answers a request on its own key", "P2.10 P9.4",
        _AB, evolve(0, eAdd(1.0), on="to"),
    ),
    _case(
        "evolve.again", "evolves once for each part of a frame", "P7.6",
        _A, evolve(0, eAdd(1.0)), SendIgnored(f"to/{MEMBER}", encode(
            m.EvolveRequest(0, (MEMBER,), (eAdd(1.0),), only=("a",)))),
        evolve(1, eAdd(1.0)), tier=Tier.ROBUST,
    ),
    _case(
        "evolve.part", "evolves again from the previous state after a rejection", "P7.7 P7.3",
        _A, evolve(0, eAdd(1.0), eName("x")), _A, evolve(0, eAdd(1.0), part=1, only=("a",)),
        evolve(1, eAdd(1.0)),
    ),
    _case(
        "evolve.parts", "answers several parts of a frame", "P7.3 P7.7",
        _AB, evolve(0, eAdd(1.0), only=("a",)), evolve(0, eAdd(1.0), part=1, only=("b",)),
        evolve(0, eAdd(1.0), part=2, only=("a", "b")),
    ),
    _case("evolve.empty", "answers without fragments", "P9.4", evolve(0, eAdd(1.0))),
    _case(
        "evolve.greeted", "keeps its fragments when it is greeted again", "P6.6",
        _A, evolve(0, eAdd(1.0)), GREET, evolve(1, eAdd(1.0)), tier=Tier.ROBUST,
    ),
    _case("evolve.end", "ends after frames", "P6.23", _A, evolve(0, eAdd(1.0)), *END),
    _case(
        "fragments.replaced", "replaces a fragment that is given again", "P9.2",
        _A, evolve(0, eAdd(1.0)), given("ACounter#a<total=100>"), evolve(1, eAdd(1.0)),
    ),
    _case(
        "fragments.dropped", "discards fragments", "P9.1",
        _AB, evolve(0, eAdd(1.0)), given(dropped=("a",)), evolve(1, eAdd(1.0)),
    ),
    _case(
        "fragments.more", "adds fragments to those that it has", "P9.1",
        _A, evolve(0, eAdd(1.0)), given("ACounter#b"), evolve(1, eAdd(1.0)),
    ),
    _case(
        "fragments.many", "evolves a thousand fragments", "P9.1 P9.6",
        given(*(f"ACounter#n{n}<total={n}>" for n in range(1000))), evolve(0, eAdd(0.5)),
    ),
    _case(
        "fragments.large", "receives and sends a large message", "P1.6 P9.1",
        given(f'ACounter#a<name="{"é" * 100_000}">'), evolve(0, eAdd(0.5)), tier=Tier.ROBUST,
    ),
)  # fmt: skip

_CONDITIONS: Final = (
    *("total < 5", "total <= 1", "total > 1", "total >= 10", "total == 10", "total != 10"),
    *('name == "é"', "not total < 5", 'total < 5 or name == "é"'),
    *('total < 5 and name == ""', 'not (total < 5 and name == "")', "births == 0"),
    *('not total == 1 and (name == "x" or total > 9.5)', "total == births", 'name != ""'),
)

_MATCHING: Final = (
    *(
        _exact(
            f"condition {number}", f"evaluates {condition}", "P3.10 P9.6",
            _AB, evolve(0, eAdd(1.0, condition=condition)),
        )
        for number, condition in enumerate(_CONDITIONS)
    ),
    _exact(
        "condition.moment", "evaluates a condition in the state of that moment", "P9.6 P9.12",
        _A, evolve(0, eAdd(4.0, condition="total < 5"), eAdd(4.0, condition="total < 5"),
                   eAdd(4.0, condition="total < 5")),
    ),
    _exact(
        "condition.receivers", "requires both the condition and a receiver", "P9.6",
        _AB, evolve(0, eAdd(1.0, condition="total < 5", receivers=("b",))),
    ),
)  # fmt: skip

_VALUES: Final = (
    *(
        _exact(
            f"value {total} + {amount}", "computes and sends reals exactly", "P3.1 P9.18",
            given(f"ACounter#a<total={total}>"), evolve(0, eAdd(amount)),
        )
        for total, amount in (
            ("0.1", 0.2), ("-0.0", -0.0), ("0", -0.0), ("-0.0", 0.0),
            ("5e-324", 5e-324), ("1e308", 7e307),
            ("9007199254740992", 1.0), ("-2.5", 2.5),
        )
    ),
    *(
        _exact(
            f"value births {births}", "keeps an integer of 64 bits", "P3.1 P9.18",
            given(f"ACounter#a<births={births}>"), evolve(0, eAdd(1.0)),
        )
        for births in ((1 << 53) + 1, (1 << 63) - 1, -(1 << 63), -1)
    ),
    _exact(
        "value.integer", "accepts an integer for a real", "P4.1",
        Deliver(
            m.Fragments({"a": VOCABULARY.read("ACounter#a<total=2>")}),
            data=pack(["fragments", {"a": [1, ["ACounter", "a", [2, "", 0], 0]]}, []]),
        ),
        evolve(0, eAdd(0.5)),
    ),
    *(
        _exact(
            f"text {name}", "keeps a text in Unicode", "P3.2",
            _A, evolve(0, eName(text)), evolve(1, eName("")),
        )
        for name, text in (
            ("two bytes", "é"), ("four bytes", "𝄞"), ("quotes", '"\\'), ("control", "\x00\n"),
            ("combining", "e\u0301"), ("separators", "\u2028"),
        )
    ),
    _exact(
        "ids", "keeps ids with colons and hyphens", "P3.8",
        given("ACounter#a:1-2_x", "ACounter#0", f"ACounter#{'z' * 64}"), evolve(0, eAdd(1.0)),
    ),
    _case(
        "frame.large", "repeats a large frame exactly", "P3.1 P7.3",
        _A, evolve((1 << 53) + 1, eAdd(1.0)), tier=Tier.EXACT, frame=(1 << 53) + 1,
    ),
)  # fmt: skip

_LIVES: Final = (
    _case(
        "birth", "answers a birth with parent and child", "P9.6 P9.19 P9.13",
        _A, evolve(0, eSplit(2.0)),
    ),
    _case(
        "birth.discarded", "discards a fragment that has become several", "P9.8",
        _AB, evolve(0, eSplit(2.0, receivers=("a",))), evolve(1, eAdd(1.0)),
    ),
    _case(
        "birth.returned", "evolves parent and child once they are given", "P9.8 P9.13",
        _A, evolve(0, eSplit(2.0)),
        given("ACounter#a<births=1>", "ACounter#a:1<total=2>"), evolve(1, eAdd(1.0)),
        evolve(2, eSplit(3.0, receivers=("a:1",))),
    ),
    _case(
        "birth.newborn", "lets a newborn process no event of its frame", "P9.13",
        _A, evolve(0, eSplit(2.0), eAdd(1.0), eAdd(4.0, receivers=("a:1",))),
    ),
    _case(
        "birth.twice", "counts births in the parent's state", "P9.19 P9.13",
        given("ACounter#a<births=4>"), evolve(0, eSplit(2.0), eSplit(3.0)),
    ),
    _case("death", "answers a death with the empty string", "P9.6", _A, evolve(0, eEnd())),
    _case(
        "death.discarded", "discards a fragment that has died", "P9.8",
        _AB, evolve(0, eEnd(receivers=("a",))), evolve(1, eAdd(1.0)),
    ),
    _case(
        "death.last", "processes no event after its death", "P9.12",
        _A, evolve(0, eAdd(1.0), eEnd(), eAdd(1.0), eCall(1.0)),
    ),
    _case(
        "death.given again", "evolves an agent that is given again", "P9.1 P9.8",
        _A, evolve(0, eEnd()), _A, evolve(1, eAdd(1.0)),
    ),
    _case(
        "emit", "sends emitted events with their sender", "P9.15 P3.11",
        _AB, evolve(0, eCall(4.0)),
    ),
    _case(
        "emit.order", "keeps the order of emitted events", "P9.15",
        _A, evolve(0, eCall(4.0), eAdd(1.0), eCall(2.0)),
    ),
    _case(
        "emit.next", "does not evolve by events that it has just emitted", "P9.15",
        _A, evolve(0, eCall(4.0)), evolve(1, eAdd(4.0, sender="a")),
    ),
    _case(
        "emit.not kept", "sends each emitted event once", "P9.15",
        _A, evolve(0, eCall(4.0)), evolve(1, eAdd(1.0)),
    ),
    _case(
        "scope", "evolves the scope first", "P9.6",
        given("ACounter#a<total=1>(ACounter#b<total=2>(ACounter#c<total=3>))"),
        evolve(0, eAdd(0.5)), evolve(1, eAdd(1.0, receivers=("c",))),
    ),
    _case(
        "scope.birth", "keeps a child within the scope", "P9.6 P9.8",
        given("ACounter#a<total=1>(ACounter#b<total=2>)"),
        evolve(0, eSplit(9.0, receivers=("b",))), evolve(1, eAdd(1.0)),
    ),
    _case(
        "scope.death", "removes an agent from a scope", "P9.6",
        given("ACounter#a<total=1>(ACounter#b<total=2>(ACounter#c))"),
        evolve(0, eEnd(receivers=("b",))), evolve(1, eAdd(1.0)),
    ),
)  # fmt: skip

_VIEWS: Final = (
    _case("view.first", "sends the views of all fragments", "P9.16", _AB, evolve(0, visual=True)),
    _case(
        "view.before", "shows the string before its evolution", "P9.16",
        _AB, evolve(0, eAdd(1.0), visual=True), evolve(1, visual=True),
    ),
    _case(
        "view.changed", "sends only views that have changed", "P9.17",
        _AB, evolve(0, visual=True), evolve(1, eAdd(1.0, receivers=("b",)), visual=True),
        evolve(2, visual=True), evolve(3, visual=True),
    ),
    _case(
        "view.same", "leaves out a view that a change has not affected", "P9.17",
        _A, evolve(0, eName("x"), visual=True), evolve(1, visual=True),
    ),
    _case(
        "view.none", "sends no views without visual events", "P9.16",
        _A, evolve(0, eAdd(1.0)), evolve(1, visual=True),
    ),
    _case(
        "view.given again", "sends the view of a fragment that is given again", "P9.17",
        _A, evolve(0, visual=True), _A, evolve(1, visual=True),
    ),
    _case(
        "view.only", "sends the views of the fragments that a request names", "P9.5 P9.16",
        _AB, evolve(0, visual=True, only=("b",)), evolve(1, visual=True),
    ),
    _case(
        "view.death", "shows an agent in the frame of its death", "P9.16 P9.8",
        _AB, evolve(0, eEnd(receivers=("a",)), visual=True), evolve(1, visual=True),
    ),
)  # fmt: skip

_CHANCE: Final = (
    _exact("chance", "draws from the agent's stream", "P9.24 P9.25 P9.26 P9.27",
           _AB, evolve(3, eDraw())),
    _exact("chance.frames", "draws from another stream in each frame", "P9.24 P9.27",
           _A, evolve(0, eDraw()), evolve(1, eDraw()), evolve((1 << 40) + 1, eDraw())),
    _exact("chance.continues", "continues a stream within a frame", "P9.27 P9.24",
           _A, evolve(3, eDraw(), eDraw(), eDraw())),
    _exact("chance.ids", "hashes every byte of an id", "P9.26 P9.24",
           given("ACounter#f1:1", f"ACounter#{'q' * 64}", "ACounter#Z_-"), evolve(3, eDraw())),
    _exact("chance.respond", "responds with a probability", "P9.30",
           given(*(f"ACounter#n{n}" for n in range(20))), evolve(3, eMaybe())),
    _exact("chance.respond again", "draws for each event with a probability", "P9.30",
           given(*(f"ACounter#n{n}" for n in range(8))), evolve(3, *[eMaybe()] * 5)),
    _exact("chance.separate", "draws responses from a separate stream", "P9.30",
           given("ACounter#n0", "ACounter#n1"), evolve(3, eMaybe(), eDraw(), eMaybe())),
    _exact("chance.condition", "draws only where the condition holds", "P9.30",
           _AB, evolve(3, eMaybe(condition="total < 5"), *[eMaybe()] * 4)),
)  # fmt: skip


_EXTREMES: Final = [f"total={'-0.0' if n % 2 else '5e-324'}, births={1 << n}" for n in range(40)]


def _batch(events: list[Event]) -> Events:
    batch = Events.of(events)
    assert batch is not None
    return batch


# A part of which agents have died may be one piece of columns or several. The host keeps only one
# piece (P9.9), so after a death these cases give the part again, or end.
_POPULATIONS: Final = (
    _case("part.add", "evolves a part of a population", "P9.9 P9.21",
          numbered(40), evolve(0, eAdd(0.5)), evolve(1, eAdd(0.25))),
    _case("part.nothing", "answers for a part that does not change", "P9.4 P9.9",
          numbered(40), evolve(0), evolve(1, eAdd(0.0, receivers=("c5",)))),
    _case("part.receivers", "evolves some agents of a part", "P9.9 P9.10",
          numbered(40), evolve(0, eAdd(0.5, receivers=("c3", "c39"))),
          evolve(1, eAdd(0.5, receivers=("c3",))), evolve(2, eName("é", receivers=("c0",)))),
    _case("part.conditions", "evaluates conditions for each agent of a part", "P9.9 P3.10",
          numbered(40), evolve(0, eAdd(0.5, condition="total < 5"))),
    _case("part.birth", "keeps a part in which agents are born", "P9.9 P9.10 P9.19",
          numbered(40), evolve(0, eSplit(9.0, receivers=("c3", "c39"))), evolve(1, eAdd(1.0))),
    _case("part.death", "keeps a part in which agents die", "P9.9 P9.10",
          numbered(40), evolve(0, eEnd(receivers=("c0", "c7", "c39"))), numbered(35),
          evolve(1, eAdd(1.0))),
    _case("part.turnover", "keeps a part through births and deaths", "P9.9 P9.10 P9.13",
          numbered(40), evolve(0, eEnd(receivers=("c1",)), eSplit(2.0, receivers=("c2",))),
          evolve(1, eAdd(1.0), eEnd(receivers=("c2:1",)))),
    _case("part.emit", "sends the events of a part's agents", "P9.15 P9.21",
          numbered(40), evolve(0, eCall(4.0, receivers=("c3", "c5")))),
    _case("part.view", "sends the view of a part", "P9.16 P9.9",
          numbered(40), evolve(0, visual=True), evolve(1, eAdd(1.0), visual=True),
          evolve(2, visual=True)),
    _case("part.view changed", "sends the changes of a part's view", "P9.10 P9.17",
          numbered(40), evolve(0, eAdd(1.0, receivers=("c7",)), visual=True),
          evolve(1, eEnd(receivers=("c2",)), visual=True)),
    _case("part.dropped", "discards a part", "P9.1",
          numbered(40), evolve(0, eAdd(1.0)), given("ACounter#a", dropped=(PART,)),
          evolve(1, eAdd(1.0))),
    _case("part.two", "evolves two parts and an agent", "P9.1 P9.9",
          numbered(40), given("ACounter#a<total=0.5>"), evolve(0, eAdd(1.0))),
    _exact("part.chance", "draws from the stream of each agent of a part", "P9.24 P9.26 P9.30",
           numbered(40), evolve(3, eDraw()), evolve(4, eMaybe())),
    _exact("part.values", "keeps the bits of reals in a part", "P3.17 P9.18",
           population(*_EXTREMES), evolve(0, eAdd(-0.0), eName("é"))),
    _exact("batch", "reads events in columns", "P3.19",
           _AB, evolve(0, _batch([eAdd(1.0), eAdd(2.0), eAdd(0.25)]))),
    _exact("batch.receivers", "reads events in columns with receivers", "P3.18 P3.19",
           _AB, evolve(0, _batch([eAdd(float(n), receivers=(r,))
                                  for n, r in enumerate(("b", "a", "b", "c"))]))),
    _exact("batch.part", "evolves a part by events in columns", "P3.19 P9.9",
           numbered(40), evolve(0, _batch([eAdd(float(n), receivers=(f"c{n}",))
                                             for n in range(30)]))),
)  # fmt: skip

_NESTED: Final = "ACounter#a(ACounter#b(ACounter#c))"

_LITERAL: Final = (
    _literal("add", "makes a copy for each event", _A, evolve(3, eAdd(1.0), eAdd(2.0))),
    _literal("one", "keeps the id of the first copy", _A, evolve(3, eAdd(1.0)),
             evolve(4, eAdd(1.0))),
    _literal("nothing", "lets agents vanish without events", _AB, evolve(3)),
    _literal("unconcerned", "copies an agent that an event does not concern",
             _AB, evolve(3, eAdd(1.0, receivers=("b",)), eName("x"))),
    _literal("birth", "makes copies with children", _A, evolve(3, eSplit(1.0), eAdd(2.0)),
             more="P9.13"),
    _literal("death", "makes no copy for a death", _A, evolve(3, eAdd(1.0), eEnd(), eAdd(2.0))),
    _literal("emit", "sends the events of copies under the agent's id",
             _A, evolve(3, eCall(1.0), eCall(2.0))),
    _literal("scope", "copies a scope with its agent",
             given("ACounter#a(ACounter#b<total=1>)"), evolve(3, eAdd(1.0), eAdd(2.0))),
    _literal("height", "names copies in a scope by the height of the copied agent",
             given(_NESTED), evolve(3, eAdd(1.0), eAdd(2.0))),
    _literal("height before", "takes the height that the copied agent had before the frame",
             given(_NESTED),
             evolve(3, eEnd(receivers=("c",)), eEnd(receivers=("c", "other")))),
    _literal("long id", "shortens the id of a copy",
             given(f"ACounter#{'w' * 64}"), evolve(3, eAdd(1.0), eAdd(2.0))),
    _literal("batch", "counts events in columns one by one",
             _A, evolve(3, _batch([eAdd(1.0), eAdd(2.0), eAdd(0.25)]))),
)  # fmt: skip

HOSTS: Final = (
    *_EVOLVING, *_MATCHING, *_VALUES, *_LIVES, *_VIEWS, *_CHANCE, *_POPULATIONS, *_LITERAL,
)  # fmt: skip
