"""Cases of coordinators: digests, views, repeated results and succession."""

from __future__ import annotations

from typing import Any, Final

from minerva_bus.grammar.parser import parse
from minerva_conformance.case import Tier
from minerva_conformance.cases.coordinator_scripts import (
    NOTHING,
    SHOWN,
    Play,
    answer,
    check,
    evolve_request,
    hosted,
    script,
    text,
)
from minerva_conformance.cases.populations import POPULATIONS
from minerva_conformance.coordinating import PlayedMember, Script, Stage
from minerva_conformance.link import CaseFailure
from minerva_conformance.world import MemberRole

_A: Final = ["ACounter", "a", [0.5, "é", 3], 0]
_B: Final = ["ACounter", "b", [1.0, "", 0], 0]
_SLOT: Final = ["ACounter", "a", None, 0]
_END_SECONDS: Final = 30.0


# --- digests ---


def _records_digests(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    answer(host, evolve_request(host, frame), changed={"a": [1, _A]})
    _, changed, digest = host.record(frame)
    check({"a": [1, _A]}, changed)
    check(parse(text(stage)).digest.hex(), digest.hex())
    generator.answer(generator.tick())
    events, changed, same = host.record(frame + 1)
    check([0, NOTHING, digest], [len(events), changed, same])


# --- views ---


def _drawn(stage: Stage, **changed: object) -> tuple[PlayedMember, PlayedMember, int]:
    """A host and a coupled device that has been asked for the events of a frame."""
    host, device = stage.member(), stage.member()
    host.join(MemberRole.HOST)
    device.join(MemberRole.COUPLED, **changed)
    return host, device, device.tick()


def _view(host: PlayedMember, device: PlayedMember, frame: int, *lengths: float) -> list[Any]:
    """Sequence, parts and skeleton of the view of a frame, in which #a shows as these bars."""
    device.answer(frame)
    request = evolve_request(host, frame)
    check([SHOWN], [event[0] for event in request[3]])
    bars = [len(lengths), *(["PBar", [length]] for length in lengths)]
    answer(host, request, views={SHOWN: {"a": bars}} if lengths else {SHOWN: {}})
    # The last view before the device joined precedes it, if there was one.
    while (view := device.receive("view"))[1] != frame:
        pass
    return view[2:5]


def _sends_key_view(stage: Stage) -> None:
    host, device, frame = _drawn(stage)
    _, parts, skeleton = _view(host, device, frame, 2.0)
    check([{"a": [1, ["PBar", [2.0]]]}, [1, _SLOT]], [parts, skeleton])


def _sends_deltas(stage: Stage) -> None:
    host, device, frame = _drawn(stage)
    sequence = _view(host, device, frame, 2.0)[0]
    delta = _view(host, device, device.tick(), 3.0, 1.0)
    check([sequence + 1, {"a": [2, ["PBar", [3.0]], ["PBar", [1.0]]]}, None], delta)
    check([sequence + 2, NOTHING, None], _view(host, device, device.tick()))


def _sends_key_view_again(stage: Stage) -> None:
    host, device, frame = _drawn(stage)
    _view(host, device, frame, 2.0)
    device.send("resync", SHOWN)
    # The answer may precede the next frame's view, or be that view.
    _, parts, skeleton = device.receive("view")[2:5]
    check([{"a": [1, ["PBar", [2.0]]]}, [1, _SLOT]], [parts, skeleton])


def _views_at_times(stage: Stage) -> None:
    host, device, frame = _drawn(stage, when="each 3 frames")
    for number in range(frame, frame + 6):
        if number % 3 == 0:
            _view(host, device, number, 2.0 + number)
        else:
            device.answer(number)
        check(number + 1, device.tick())


# --- repeated and late results ---


def _takes_first_result(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    request = evolve_request(host, frame)
    for total in (1.5, 2.5):
        answer(host, request, changed={"a": [1, ["ACounter", "a", [total, "", 0], 0]]})
    generator.answer(generator.tick())
    generator.tick()
    check('ACounter#a<total=1.5, name="", births=0>()', text(stage))


def _drops_other_part(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    request = evolve_request(host, frame)
    answer(host, request, part=request[4] + 5, changed={"a": [1, _A]})
    generator.receive_none("tick", "refused", "stop")
    answer(host, request)
    generator.tick()


def _refuses_others_agent(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    answer(host, evolve_request(host, frame), changed={"b": [1, _B]})
    host.receive("refused")


# --- succession ---


def _gives_way(stage: Stage) -> None:
    member = stage.member()
    member.join()
    frame = member.tick()
    member.bus.declare_token(f"epoch/{member.epoch + 1}")
    if stage.process.code(_END_SECONDS) is None:
        raise CaseFailure("it has not ended")
    member.answer(frame)
    member.receive_none("tick", "stop")


def _case(name: str, title: str, requirements: str, play: Play, tier: Tier = Tier.EXACT) -> Script:
    return script(name, title, requirements, play, tier)


COORDINATED: Final[tuple[Script, ...]] = (
    _case("digest", "records the digest of the string", "P12.1 P5.1 P5.2", _records_digests),
    _case("view.key", "sends a new device a key view", "P10.2 P10.6", _sends_key_view),
    _case("view.delta", "sends changed parts only", "P10.3 P10.4", _sends_deltas),
    _case("view.resync", "sends a key view again", "P10.5 P10.2", _sends_key_view_again),
    _case("view.every", "requests views at the times of a device", "P7.1", _views_at_times),
    *POPULATIONS,
    _case("evolved.repeated", "takes the first of two results", "P7.4 P14.5",
          _takes_first_result, Tier.ROBUST),
    _case("evolved.part", "drops a result for another part", "P7.3 P7.4", _drops_other_part,
          Tier.ROBUST),
    _case("evolved.foreign", "refuses results for fragments of others", "P9.5 P14.3",
          _refuses_others_agent, Tier.ROBUST),
)  # fmt: skip
SUCCEEDED: Final = (
    script("succession", "ends when a higher epoch is announced", "P2.9", _gives_way,
           Tier.ROBUST, ends=True),
)  # fmt: skip
"""Played last, because the coordinator ends."""
