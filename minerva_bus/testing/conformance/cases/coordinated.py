"""Cases of coordinators: digests, views, populations, repeated results and succession."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from minerva_bus.grammar.parser import parse
from minerva_bus.testing.conformance.case import Tier
from minerva_bus.testing.conformance.cases.coordinator_scripts import (
    check,
    evolve_request,
    hosted,
    script,
)
from minerva_bus.testing.conformance.coordinating import PlayedMember, Stage
from minerva_bus.testing.conformance.link import CaseFailure
from minerva_bus.testing.conformance.world import MemberRole
from minerva_bus.wire.arrays import plain_array, read_ids

Play = Callable[[Stage], None]
Request = list[Any]

_SIZE: Final = 140
"""Agents of a population, enough for two hosts (P9.31)."""
_A: Final = ["ACounter", "a", [0.5, "é", 3], 0]
_B: Final = ["ACounter", "b", [1.0, "", 0], 0]
_SLOT: Final = ["ACounter", "a", None, 0]
_TYPE: Final = "eShow"
_NONE: Final[dict[str, Any]] = {}
_END_SECONDS: Final = 30.0


def _answer(host: PlayedMember, request: Request, **changed: Any) -> None:
    """Answer a request of evolution by changed fragments, emitted events and views."""
    items = {"changed": _NONE, "emitted": _NONE, "views": _NONE, "part": request[4], **changed}
    host.send("evolved", request[0], *(items[n] for n in ("part", "changed", "emitted", "views")))


def _text(stage: Stage) -> str:
    return str(stage.ask({"ask": "scene"})["scene"])


# --- digests ---


def _records_digests(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    _answer(host, evolve_request(host, frame), changed={"a": [1, _A]})
    _, changed, digest = host.record(frame)
    check({"a": [1, _A]}, changed)
    check(parse(_text(stage)).digest.hex(), digest.hex())
    generator.answer(generator.tick())
    events, changed, same = host.record(frame + 1)
    check([0, _NONE, digest], [len(events), changed, same])


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
    check([_TYPE], [event[0] for event in request[3]])
    bars = [len(lengths), *(["PBar", [length]] for length in lengths)]
    _answer(host, request, views={_TYPE: {"a": bars}} if lengths else {_TYPE: {}})
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
    check([sequence + 2, _NONE, None], _view(host, device, device.tick()))


def _sends_key_view_again(stage: Stage) -> None:
    host, device, frame = _drawn(stage)
    _view(host, device, frame, 2.0)
    device.send("resync", _TYPE)
    # The answer may precede the next frame's view, or be that view.
    _, parts, skeleton = device.receive("view")[2:5]
    check([{"a": [1, ["PBar", [2.0]]]}, [1, _SLOT]], [parts, skeleton])


def _views_at_times(stage: Stage) -> None:
    host, device, frame = _drawn(stage, every=3)
    for number in range(frame, frame + 6):
        if number % 3 == 0:
            _view(host, device, number, 2.0 + number)
        else:
            device.answer(number)
        check(number + 1, device.tick())


# --- populations ---


def _grown(stage: Stage, count: int, **changed: Any) -> tuple[list[PlayedMember], PlayedMember]:
    """Hosts, and a generator that has answered the first frame with a population instead of #a."""
    hosts, generator = [stage.member() for _ in range(count)], stage.member()
    for host in hosts:
        host.join(MemberRole.HOST, **changed)
    generator.join()
    frame = generator.tick()
    generator.answer(frame, 1.0)
    counters = [["ACounter", f"c{n}", [float(n), "", 0], 0] for n in range(_SIZE)]
    # Every host that takes columns gets the request, which names the one that has #a.
    requests = {host.bus.name: evolve_request(host, frame) for host in hosts}
    (owner,) = [host for host in hosts if host.bus.name in requests[host.bus.name][1]]
    _answer(owner, requests[owner.bus.name], changed={"a": [_SIZE, *counters]})
    generator.answer(generator.tick(), 1.0)
    return hosts, generator


def _restored(play: Play) -> Play:
    """A case with a population, after which the string is a single agent again."""

    def whole(stage: Stage) -> None:
        try:
            play(stage)
        finally:
            stage.clear()
            host, generator, frame = hosted(stage)
            generator.answer(frame, 9.0)
            fragments, _ = host.receive("fragments")
            changed: dict[str, list[Any]] = {name: [0] for name in sorted(fragments)}
            changed[min(changed)] = [1, _A]
            _answer(host, evolve_request(host, frame), changed=changed)
            generator.tick()

    return whole


def _part(host: PlayedMember) -> tuple[str, list[Any]]:
    """Name and string of the part of a population that a host gets next."""
    fragments, _ = host.receive("fragments")
    ((name, string),) = fragments.items()
    check("~", name[:1])
    return name, string


def _gives_nodes(stage: Stage) -> None:
    (host,), generator = _grown(stage, 1)
    name, string = _part(host)
    check([_SIZE, ["ACounter", "c0", [0.0, "", 0], 0]], string[:2])
    request = evolve_request(host, generator.asked)
    check([name], request[5])
    _answer(host, request)
    generator.tick()


def _gives_columns(stage: Stage) -> None:
    (host,), generator = _grown(stage, 1, plain=False)
    _, string = _part(host)
    check([1, _SIZE, "ACounter"], [string[0], string[1][0], string[1][2][0][0]])
    _answer(host, evolve_request(host, generator.asked))
    generator.tick()


def _patch(count: int) -> list[Any]:
    """Row 3 of a population of this size has the total 0.25."""
    rows, totals = plain_array(np.array([3])), plain_array(np.array([0.25]))
    return ["patch", count, ["ACounter"], [[0, 0, rows, totals]]]


def _takes_patch(stage: Stage) -> None:
    (host,), generator = _grown(stage, 1, plain=False)
    name, _ = _part(host)
    _answer(host, evolve_request(host, generator.asked), changed={name: _patch(_SIZE)})
    generator.tick()
    texts = _text(stage).split(" · ")
    check([_SIZE, 'ACounter#c3<total=0.25, name="", births=0>()'], [len(texts), texts[3]])


def _refuses_patch(stage: Stage) -> None:
    (host,), generator = _grown(stage, 1, plain=False)
    name, _ = _part(host)
    _answer(host, evolve_request(host, generator.asked), changed={name: _patch(_SIZE + 1)})
    host.receive("refused")


def _splits(stage: Stage) -> None:
    hosts, generator = _grown(stage, 2, plain=False)
    parts = [_part(host)[1][1] for host in sorted(hosts, key=lambda host: host.bus.name)]
    check([_SIZE // 2] * 2, [part[0] for part in parts])
    ids = [list(read_ids(part[1], part[0])) for part in parts]
    check([f"c{n}" for n in range(_SIZE)], [*ids[0], *ids[1]])
    for host in hosts:
        _answer(host, evolve_request(host, generator.asked))
    generator.tick()


# --- repeated and late results ---


def _takes_first_result(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    request = evolve_request(host, frame)
    for total in (1.5, 2.5):
        _answer(host, request, changed={"a": [1, ["ACounter", "a", [total, "", 0], 0]]})
    generator.answer(generator.tick())
    generator.tick()
    check('ACounter#a<total=1.5, name="", births=0>()', _text(stage))


def _drops_other_part(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    request = evolve_request(host, frame)
    _answer(host, request, part=request[4] + 5, changed={"a": [1, _A]})
    generator.receive_none("tick", "refused", "stop")
    _answer(host, request)
    generator.tick()


def _refuses_others_agent(stage: Stage) -> None:
    host, generator, frame = hosted(stage)
    generator.answer(frame, 1.0)
    _answer(host, evolve_request(host, frame), changed={"b": [1, _B]})
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


def _case(name: str, title: str, requirements: str, play: Play, tier: Tier = Tier.EXACT) -> Any:
    return script(name, title, requirements, play, tier)


COORDINATED: Final = (
    _case("digest", "records the digest of the string", "P12.1 P5.1 P5.2", _records_digests),
    _case("view.key", "sends a new device a key view", "P10.2 P10.6", _sends_key_view),
    _case("view.delta", "sends changed parts only", "P10.3 P10.4", _sends_deltas),
    _case("view.resync", "sends a key view again", "P10.5 P10.2", _sends_key_view_again),
    _case("view.every", "requests views at the times of a device", "P7.1", _views_at_times),
    _case("population.nodes", "gives a part of a population as nodes", "P9.21 P9.31",
          _restored(_gives_nodes)),
    _case("population.columns", "gives a part of a population as columns", "P9.1 P3.15 P9.31",
          _restored(_gives_columns)),
    _case("population.patch", "takes a patch of a part", "P9.10 P3.20", _restored(_takes_patch)),
    _case("population.misfit", "refuses a patch that does not fit", "P9.11",
          _restored(_refuses_patch), Tier.ROBUST),
    _case("population.hosts", "splits a population among hosts", "P9.31", _restored(_splits)),
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
