"""Cases of coordinators with populations: parts, columns and patches."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from minerva_bus.wire.columns_codec import plain_array, read_ids
from minerva_conformance.case import Tier
from minerva_conformance.cases.coordinator_scripts import (
    SHOWN,
    Play,
    answer,
    check,
    evolve_request,
    hosted,
    script,
    text,
)
from minerva_conformance.coordinating import PlayedMember, Script, Stage
from minerva_conformance.world import MemberRole

_SIZE: Final = 140
"""Agents of a population, enough for two hosts (P9.31)."""
_POPULATION: Final = [_SIZE, *(["ACounter", f"c{n}", [float(n), "", 0], 0] for n in range(_SIZE))]
_A: Final = ["ACounter", "a", [0.5, "é", 3], 0]


def _grown(stage: Stage, count: int, **changed: Any) -> tuple[list[PlayedMember], PlayedMember]:
    """Hosts, and a generator that has answered the first frame with a population instead of #a."""
    hosts, generator = [stage.member() for _ in range(count)], stage.member()
    for host in hosts:
        host.join(MemberRole.HOST, **changed)
    generator.join()
    frame = generator.tick()
    generator.answer(frame, 1.0)
    # Every host that takes columns gets the request, which names the one that has #a.
    requests = {host.bus.name: evolve_request(host, frame) for host in hosts}
    (owner,) = [host for host in hosts if host.bus.name in requests[host.bus.name][1]]
    answer(owner, requests[owner.bus.name], changed={"a": _POPULATION})
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
            answer(host, evolve_request(host, frame), changed=changed)
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
    answer(host, request)
    generator.tick()


def _gives_columns(stage: Stage) -> None:
    (host,), generator = _grown(stage, 1, plain=False)
    _, string = _part(host)
    check([1, _SIZE, "ACounter"], [string[0], string[1][0], string[1][2][0][0]])
    answer(host, evolve_request(host, generator.asked))
    generator.tick()


def _patch(count: int) -> list[Any]:
    """Row 3 of a population of this size has the total 0.25."""
    rows, totals = plain_array(np.array([3])), plain_array(np.array([0.25]))
    return ["patch", count, ["ACounter"], [[0, 0, rows, totals]]]


def _takes_patch(stage: Stage) -> None:
    (host,), generator = _grown(stage, 1, plain=False)
    name, _ = _part(host)
    answer(host, evolve_request(host, generator.asked), changed={name: _patch(_SIZE)})
    generator.tick()
    texts = text(stage).split(" · ")
    check([_SIZE, 'ACounter#c3<total=0.25, name="", births=0>()'], [len(texts), texts[3]])


def _refuses_patch(stage: Stage) -> None:
    (host,), generator = _grown(stage, 1, plain=False)
    name, _ = _part(host)
    answer(host, evolve_request(host, generator.asked), changed={name: _patch(_SIZE + 1)})
    host.receive("refused")


def _takes_view_patch(stage: Stage) -> None:
    host, device = stage.member(), stage.member()
    host.join(MemberRole.HOST, plain=False)
    device.join(MemberRole.COUPLED)

    def next_request() -> list[Any]:
        device.answer(device.tick())
        return evolve_request(host, device.asked)

    def drawn(request: list[Any], name: str, view: list[Any], **changed: Any) -> Any:
        """What the device gets as the view of this fragment."""
        answer(host, request, views={SHOWN: {name: view}}, **changed)
        # The last view before the device joined precedes it, if there was one.
        while (shown := device.receive("view"))[1] != request[0]:
            pass
        return shown[3].get(name)

    drawn(next_request(), "a", [0], changed={"a": _POPULATION})
    device.answer(device.tick())
    name, _ = _part(host)
    lengths = np.arange(_SIZE) / 4
    columns = [1, [_SIZE, None, [["PBar", [plain_array(lengths)]]]]]
    bars = [["PBar", [length]] for length in lengths.tolist()]
    check([_SIZE, *bars], drawn(evolve_request(host, device.asked), name, columns))
    rows, bars[3] = plain_array(np.array([3])), ["PBar", [100.0]]
    patch = ["patch", _SIZE, ["PBar"], [[0, 0, rows, plain_array(np.array([100.0]))]]]
    check([_SIZE, *bars], drawn(next_request(), name, patch))


def _splits(stage: Stage) -> None:
    hosts, generator = _grown(stage, 2, plain=False)
    parts = [_part(host)[1][1] for host in sorted(hosts, key=lambda host: host.bus.name)]
    check([_SIZE // 2] * 2, [part[0] for part in parts])
    ids = [list(read_ids(part[1], part[0])) for part in parts]
    check([f"c{n}" for n in range(_SIZE)], [*ids[0], *ids[1]])
    for host in hosts:
        answer(host, evolve_request(host, generator.asked))
    generator.tick()


POPULATIONS: Final[tuple[Script, ...]] = (
    script("population.nodes", "gives a part of a population as nodes", "P9.21 P9.31",
           _restored(_gives_nodes), Tier.EXACT),
    script("population.columns", "gives a part of a population as columns", "P9.1 P3.15 P9.31",
           _restored(_gives_columns), Tier.EXACT),
    script("population.patch", "takes a patch of a part", "P9.10 P3.20",
           _restored(_takes_patch), Tier.EXACT),
    script("population.misfit", "refuses a patch that does not fit", "P9.11",
           _restored(_refuses_patch), Tier.ROBUST),
    script("population.view patch", "takes a patch of a part's view", "P9.10 P9.21 P10.3",
           _restored(_takes_view_patch), Tier.EXACT),
    script("population.hosts", "splits a population among hosts", "P9.31",
           _restored(_splits), Tier.EXACT),
)  # fmt: skip
