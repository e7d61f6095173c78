"""Short forms of the steps that many cases share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.grammar.columns import packed
from minerva_bus.grammar.events import AnyEvent, single
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.world.readings import Sighting, Sightings
from minerva_conformance.case import (
    AwaitEnd,
    Case,
    CutLink,
    Deliver,
    Disappear,
    PublishReadings,
    Reappear,
    Step,
    Tier,
)
from minerva_conformance.world import MEMBER, VOCABULARY, MemberRole, PBar, eShow

GENERATOR: Final = (MemberRole.GENERATOR,)
HOST: Final = (MemberRole.HOST,)
OBSERVER: Final = (MemberRole.OBSERVER,)
COUPLED: Final = (MemberRole.COUPLED,)
ANY_DEVICE: Final = (MemberRole.OBSERVER, MemberRole.COUPLED)
TICKED: Final = (MemberRole.GENERATOR, MemberRole.COUPLED)
EVERY_ROLE: Final = tuple(MemberRole)

GREET: Final = Deliver(m.Greet())
STOP: Final = Deliver(m.Stop("the world has ended"))
END: Final = (STOP, AwaitEnd())
PART: Final = "~ACounter.1"


def tick(frame: int, on: str = "") -> Deliver:
    """Request the events of a frame."""
    return Deliver(m.TickRequest(frame), on)


def ticks(*frames: int) -> tuple[Deliver, ...]:
    """Request the events of several frames."""
    return tuple([tick(frame) for frame in frames])


def sights(publisher: str, frame: int, *distances: float, marker: str = "door") -> PublishReadings:
    """Another member's sightings of a marker at these distances, in metres."""
    seen = tuple([Sighting(marker, distance, 0.0) for distance in distances])
    readings = (Sightings("r1", seen, 0.5),) if seen else ()
    return PublishReadings(m.Readings(publisher, "sight", frame, readings))


def given(*texts: str, dropped: Iterable[str] = ()) -> Deliver:
    """Give fragments, each an agent as text, to a host; discard others."""
    scenes = [VOCABULARY.read(text) for text in texts]
    fragments = {_only_agent(scene).id: scene for scene in scenes}
    return Deliver(m.Fragments(fragments, tuple(dropped)))


def _only_agent(scene: Scene) -> AgentNode:
    (node,) = scene.nodes
    assert isinstance(node, AgentNode)
    return node


def population(*attributes: str) -> Deliver:
    """Give a part of a population, whose agents c0, c1, ... have these attributes."""
    text = " · ".join(f"ACounter#c{n}<{given}>" for n, given in enumerate(attributes))
    return Deliver(m.Fragments({PART: packed(VOCABULARY.read(text))}))


def numbered(count: int) -> Deliver:
    """Give a part of a population whose totals are 0, 1, ..."""
    return population(*(f"total={n}" for n in range(count)))


def evolve(
    frame: int,
    *events: AnyEvent,
    visual: bool = False,
    part: int = 0,
    only: tuple[str, ...] = (),
    on: str = "",
) -> Deliver:
    """Request the evolution of the member's fragments, and their views if `visual`."""
    shown = (eShow(),) if visual else ()
    return Deliver(m.EvolveRequest(frame, (MEMBER,), events, shown, part, only), on)


def key_view(frame: int, sequence: int, **lengths: float | None) -> Deliver:
    """A key view with a bar of a length for each agent; None: the agent has no view."""
    skeleton = Scene(tuple([AgentNode("ACounter", agent) for agent in lengths]))
    return Deliver(
        m.ViewShown("eShow", frame, sequence, _bars(lengths), skeleton if lengths else Scene())
    )


def delta_view(frame: int, sequence: int, **lengths: float | None) -> Deliver:
    """A view with the changed bars only."""
    return Deliver(m.ViewShown("eShow", frame, sequence, _bars(lengths)))


def _bars(lengths: Mapping[str, float | None]) -> dict[str, Scene]:
    return {agent: Scene() if length is None else PBar(length) for agent, length in lengths.items()}


@dataclass(frozen=True, slots=True)
class CaseGroup:
    """What the cases of a group share: the beginning of their names, and defaults."""

    prefix: str = ""
    roles: tuple[MemberRole, ...] = EVERY_ROLE
    tier: Tier = Tier.PARTICIPATES
    joined: bool = True
    ending: tuple[Step, ...] = ()

    def case(
        self,
        name: str,
        title: str,
        requirements: str,
        *steps: Step,
        roles: Iterable[MemberRole] | None = None,
        tier: Tier | None = None,
        requires: str = "",
        joined: bool | None = None,
        policy: str = "sequential",
        name_taken: bool = False,
        frame: int = 0,
    ) -> Case:
        """A case with these steps, and the ending of the group; the rest as in `Case`."""
        steps = (*steps, *self.ending)
        return Case(
            self.prefix + name, title, concerned(requirements, steps), tier or self.tier,
            self.roles if roles is None else tuple(roles), steps,
            requires=frozenset(requires.split()),
            joined=self.joined if joined is None else joined,
            policy=policy, name_taken=name_taken, frame=frame,
        )  # fmt: skip


def concerned(requirements: str, steps: Iterable[Step]) -> tuple[str, ...]:
    """These requirements, and those that the steps concern whatever the case is about."""
    implied = [name for step in steps for name in _implied(step)]
    return tuple(dict.fromkeys([*requirements.split(), *implied]))


def _implied(step: Step) -> Iterator[str]:
    match step:
        case Disappear():
            yield "P6.16"
        case Reappear() | CutLink():
            yield "P6.17"
        case Deliver(m.Stop()):
            yield "P6.23"
        case Deliver(m.TickRequest()):
            yield "P8.3"
        case Deliver(m.Orders()):
            yield "P7.1"
        case Deliver(m.Sources()):
            yield "P11.4"
        case Deliver(m.EvolveRequest() as request):
            yield from _implied_by_request(request)
        case _:
            return


def _implied_by_request(request: m.EvolveRequest) -> Iterator[str]:
    events = tuple(single(request.events))
    if any(event.receivers for event in events):
        yield "P9.6"
    if any(event.condition for event in events):
        yield "P3.10"
    if any(event.type == "eCall" for event in events):
        yield "P9.15"
    if request.visual:
        yield "P9.16"
        yield "P9.17"
    if request.only:
        yield "P9.5"
