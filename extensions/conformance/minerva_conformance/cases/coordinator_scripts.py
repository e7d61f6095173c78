"""What the cases of coordinators have in common."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeAlias

from minerva_conformance.case import Case, CoordinatorRole, Tier
from minerva_conformance.coordinating import PlayedMember, Script, Stage
from minerva_conformance.link import CaseFailure
from minerva_conformance.world import MemberRole

Play: TypeAlias = Callable[[Stage], None]
SHOWN: Final = "eShow"
"""The visual event type of the world."""
NOTHING: Final[dict[str, Any]] = {}


def script(
    name: str,
    title: str,
    requirements: str,
    play: Play,
    tier: Tier = Tier.PARTICIPATES,
    *,
    ends: bool = False,
) -> Script:
    """A case of coordinators."""
    roles = (CoordinatorRole.COORDINATOR,)
    case = Case(f"coordinator.{name}", title, tuple(requirements.split()), tier, roles)
    return Script(case, play, ends)


def check(expected: object, received: object) -> None:
    """Raise CaseFailure if the two differ."""
    if expected != received:
        raise CaseFailure("another answer than expected", [str(expected)], [str(received)])


def hosted(stage: Stage, **changed: object) -> tuple[PlayedMember, PlayedMember, int]:
    """A host and a generator that has been asked for the events of a frame; a hello may differ."""
    host, generator = stage.member(), stage.member()
    host.join(MemberRole.HOST, **changed)
    generator.join()
    return host, generator, generator.tick()


def evolve_request(host: PlayedMember, frame: int) -> list[Any]:
    """The request of this frame; the host answers those before it."""
    while True:
        request = host.receive("evolve")
        if request[0] == frame:
            return request
        host.send("evolved", request[0], request[4], {}, {}, {})


def answer(host: PlayedMember, request: list[Any], **changed: Any) -> None:
    """Answer a request of evolution by changed fragments, emitted events and views."""
    items = {"part": request[4], "changed": NOTHING, "emitted": NOTHING, "views": NOTHING}
    host.send("evolved", request[0], *{**items, **changed}.values())


def text(stage: Stage) -> str:
    """The string of the world."""
    return str(stage.ask({"ask": "scene"})["scene"])
