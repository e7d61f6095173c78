"""Cases of coordinators: joining, ticks, evolution, and late, repeated and invalid messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from minerva_bus.wire.codec import stamp
from minerva_bus.wire.plain import pack
from minerva_conformance.case import Tier
from minerva_conformance.cases.coordinated import COORDINATED, SUCCEEDED
from minerva_conformance.cases.coordinator_scripts import (
    check,
    evolve_request,
    hosted,
    script,
)
from minerva_conformance.coordinating import PlayedMember, Stage, hello, join_both
from minerva_conformance.link import CaseFailure
from minerva_conformance.world import DT, SEED, MemberRole

# --- joining ---


def _greets(stage: Stage) -> None:
    stage.member().greeted()


def _announces_epoch(stage: Stage) -> None:
    member = stage.member().greeted()
    check({f"minerva/{stage.world}/epoch/{member.epoch}",
            f"minerva/{stage.world}/alive/coordinator"}, member.tokens)  # fmt: skip


def _welcomes(stage: Stage) -> None:
    world, vocabulary, seed, dt, frame, policy, saved = stage.member().join()
    check([stage.world, SEED, DT, "sequential", None], [world, seed, dt, policy, saved])
    check(True, isinstance(frame, int) and frame >= 0)
    check({"ACounter"}, {kind[0] for kind in vocabulary["kinds"]})


def _welcomes_once(stage: Stage) -> None:
    member = stage.member()
    member.join()
    member.send("hello", hello(MemberRole.GENERATOR))
    member.receive_none("welcome", "refused")


def _refuses(**changed: object) -> Callable[[Stage], None]:
    """The hello of a generator with these keys changed is refused."""

    def play(stage: Stage) -> None:
        member = stage.member().greeted()
        member.send("hello", hello(MemberRole.GENERATOR, **changed))
        member.receive("refused")

    return play


def _ignores_name(stage: Stage) -> None:
    member = stage.member("~member")
    member.bus.appear()
    member.receive_none("greet")


def _ignores_later_key(stage: Stage) -> None:
    stage.member().join(later=True)


_OTHER_KIND: Final = ["ACounter", [["total", "text", None]], [], [], []]
_JOINING: Final = (
    script("greet", "greets a member whose token appears", "P6.5", _greets, Tier.JOINS),
    script("epoch", "announces its epoch", "P2.5 P2.9", _announces_epoch, Tier.JOINS),
    script("welcome", "welcomes a member", "P8.1", _welcomes, Tier.JOINS),
    script("hello", "counts a repeated hello once", "P6.6", _welcomes_once, Tier.JOINS),
    script("version", "refuses another version", "P6.9 P16.1", _refuses(version=5), Tier.JOINS),
    script("event type", "refuses an unknown event type", "P6.9", _refuses(generates=["eFar"]),
            Tier.JOINS),
    script("kind", "refuses a kind with other attributes", "P6.9", _refuses(kinds=[_OTHER_KIND]),
            Tier.JOINS),
    script("name", "ignores a member with an invalid name", "P2.1 P2.2", _ignores_name,
            Tier.JOINS),
    script("later key", "ignores unknown keys of a hello", "P8.2 P16.2",
            _ignores_later_key, Tier.JOINS),
)  # fmt: skip


# --- frames ---


def _ticks(stage: Stage) -> None:
    member = stage.member()
    frame = member.join()[4]
    for expected in range(frame, frame + 5):
        check(expected, member.tick())
        member.answer(expected)


def _waits(stage: Stage) -> None:
    member = stage.member()
    member.join()
    frame = member.tick()
    member.receive_none("tick")
    member.answer(frame)
    check(frame + 1, member.tick())


def _orders_events(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 2.0, 1.0, 2.0)
    events = [[event[0], list(event[1])] for event in evolve_request(host, frame)[2]]
    check([["eAdd", [2.0]], ["eAdd", [1.0]]], events)


def _gives_fragments(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    given, _ = host.receive("fragments")
    check(["a"], sorted(given))
    check([1, ["ACounter", "a"]], [given["a"][0], given["a"][1][:2]])
    check(frame, host.receive("evolve")[0])


def _takes_result(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    part = evolve_request(host, frame)[4]
    total = frame + 0.25
    host.send("evolved", frame, part, {"a": [1, ["ACounter", "a", [total, "é", 3], 0]]}, {}, {})
    generator.tick()
    text = stage.ask({"ask": "fragment", "agent": "a"})["fragment"]
    check(f'ACounter#a<total={total}, name="é", births=3>()', text)


def _passes_emitted_on(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    part = evolve_request(host, frame)[4]
    host.send("evolved", frame, part, {}, {"a": [["eAdd", [0.5], "", "a", ["a"]]]}, {})
    generator.answer(generator.tick())
    check([["eAdd", [0.5], "", "a", ["a"]]], evolve_request(host, frame + 1)[2])


def _keeps_saved(stage: Stage) -> None:
    member = stage.member()
    member.join()
    frame = member.tick()
    member.answer(frame, saved={"count": 7})
    member.tick()
    member.bus.vanish()
    check({"count": 7}, member.join()[6])


_FRAMES: Final = (
    script("ticks", "requests the events of each frame", "P7.3", _ticks),
    script("waits", "waits for the answer of a generator", "P15.1", _waits),
    script("events", "orders events, and keeps the first of equal ones", "P7.2", _orders_events),
    script("fragments", "gives a host the fragments of its kinds", "P9.1", _gives_fragments),
    script("changed", "takes the results of a host", "P9.7 P13.1", _takes_result),
    script("emitted", "passes emitted events on in the next frame", "P9.15 P7.1",
            _passes_emitted_on),
    script("saved", "gives saved data to a successor", "P8.5 P6.20", _keeps_saved, Tier.EXACT),
)  # fmt: skip


# --- late, repeated and invalid messages ---


def _continues(member: PlayedMember, frame: int) -> None:
    """Check that the member takes part: its answer leads to the next tick."""
    member.answer(frame)
    check(frame + 1, member.tick())


def _drops_late(stage: Stage) -> None:
    member = stage.member()
    member.join()
    frame = member.tick()
    member.answer(frame, 1.0)
    member.tick()
    member.answer(frame, 2.0)
    member.receive_none("refused", "tick")
    _continues(member, frame + 1)


def _drops_early(stage: Stage) -> None:
    member = stage.member()
    member.join()
    frame = member.tick()
    member.answer(frame + 1, 2.0)
    member.receive_none("refused", "tick")
    _continues(member, frame)


def _ignores_epoch(later: int) -> Callable[[Stage], None]:
    def play(stage: Stage) -> None:
        member = stage.member()
        member.join()
        frame = member.tick()
        member.send("ticked", frame, [], None, later=later)
        member.receive_none("refused", "tick")
        _continues(member, frame)

    return play


def _ignores_empty(stage: Stage) -> None:
    member = stage.member()
    member.join()
    frame = member.tick()
    member.send_bytes(b"")
    member.receive_none("refused")
    _continues(member, frame)


def _expels(body: bytes) -> Callable[[Stage], None]:
    """The sender of this message is refused, and the world continues without it."""

    def play(stage: Stage) -> None:
        member, witness, frame = join_both(stage)
        member.send_bytes(stamp(member.epoch) + body)
        member.receive("refused")
        _continues(witness, frame)

    return play


def _continues_without(part: Callable[[PlayedMember], None]) -> Callable[[Stage], None]:
    def play(stage: Stage) -> None:
        member, witness, frame = join_both(stage)
        part(member)
        _continues(witness, frame)

    return play


def _fails(member: PlayedMember) -> None:
    member.send("failed", 0, "a problem", "")
    member.bus.vanish()


_GARBAGE: Final[Mapping[str, tuple[str, bytes]]] = {
    "reserved byte": ("P14.2", b"\xc1"),
    "no list": ("P14.2", pack({"ticked": 1})),
    "unknown message": ("P14.2", pack(["tock"])),
    "too few items": ("P14.2", pack(["ticked", 0])),
    "wrong type": ("P14.2", pack(["ticked", "0", [], None])),
    "negative frame": ("P14.2", pack(["ticked", -1, [], None])),
    "unknown event": ("P14.2", pack(["ticked", 0, [["eFar", []]], None])),
    "missing data": ("P14.2", pack(["ticked", 0, [["eAdd", []]], None])),
    "not finite": ("P14.2", pack(["ticked", 0, [["eAdd", [float("inf")]]], None])),
    "cut off": ("P14.2", pack(["ticked", 0, [], None])[:-1]),
    "undeclared event": ("P14.3", pack(["emitted", [["eEnd", []]]])),
    "sender": ("P3.12", pack(["emitted", [["eAdd", [1.0], "", "a", []]]])),
    "too large": ("P14.1", pack(["resync", "x" * 300_000])),
    "too deep": ("P14.2", b"\x92\xa6report" + b"\x91" * 2000 + b"\xc0"),
}
_ROBUST: Final = (
    script("late", "drops a late reply", "P7.4 P14.5", _drops_late, Tier.ROBUST),
    script("early", "drops a reply for a frame that is not awaited", "P7.4", _drops_early,
            Tier.ROBUST),
    script("older epoch", "ignores an older epoch", "P2.8", _ignores_epoch(-1), Tier.ROBUST),
    script("newer epoch", "ignores a newer epoch", "P2.8", _ignores_epoch(1), Tier.ROBUST),
    script("empty", "ignores an empty payload", "P2.3 P14.5", _ignores_empty, Tier.ROBUST),
    *(
        script(f"garbage.{name}", "refuses an invalid message", f"{rule} P14.3", _expels(body),
                Tier.ROBUST)
        for name, (rule, body) in _GARBAGE.items()
    ),
    script("leaving", "continues without a member that leaves", "P6.21",
            _continues_without(PlayedMember.leave), Tier.ROBUST),
    script("failed", "continues without a member that fails", "P6.22",
            _continues_without(_fails),
            Tier.ROBUST),
    script("gone", "continues without a member whose token vanishes", "P6.21",
            _continues_without(lambda member: member.bus.vanish()), Tier.ROBUST),
)  # fmt: skip


# --- questions and the end ---


def _answers_invalid(stage: Stage) -> None:
    check(["error"], list(stage.ask({"ask": "something else"})))


def _stops(stage: Stage) -> None:
    member = stage.member()
    member.join()
    member.tick()
    stage.ask({"ask": "stop"})
    member.receive("stop")
    member.send("report", {"ticks": 1})
    while member.tokens:
        if member.next() is None and member.tokens:
            raise CaseFailure("its tokens are still there", (), sorted(member.tokens))
    if stage.process.code(30.0) is None:
        raise CaseFailure("it has not ended")


_QUESTIONS: Final = (
    script("question", "answers an invalid question by an error", "P13.2", _answers_invalid,
            Tier.ROBUST),
    script("stop", "stops its members, awaits their reports, and ends", "P6.23", _stops,
            ends=True),
)  # fmt: skip

COORDINATORS: Final = (
    *_JOINING, *_FRAMES, *COORDINATED, *_ROBUST, *_QUESTIONS, *SUCCEEDED,
)  # fmt: skip
"""All cases of coordinators, in the order in which they are played."""
