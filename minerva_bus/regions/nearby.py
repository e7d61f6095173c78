"""Services that run in each region, because they perceive what is near an agent only.

A region answers for the agents that it had when the frame of the view began. If one of them has
moved since, it sends the events to the agent's new region, which waits for them:

    frame t      each region sends figures near the cells of others to them, in its parcels
    frame t + 1  its services see these and its own, and their events go to where the agents are,
                 with what the services have saved of agents that have moved
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import ProtocolError, WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.frame.calling import restore, saved_by
from minerva_bus.frame.member import Member
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.ids import Ids
from minerva_bus.regions.asking import answers_of
from minerva_bus.regions.halo_part import HaloPart
from minerva_bus.regions.halo_services import halo_services
from minerva_bus.regions.kept import AGENTS, check_saved, kept_by, parted, texts_of, with_texts
from minerva_bus.regions.merging import PlacedEvent, Units
from minerva_bus.regions.nearby_views import NearbyViews
from minerva_bus.regions.partition import Partition
from minerva_bus.regions.place_table import taken
from minerva_bus.regions.replies import Answer, Replies, received
from minerva_bus.world.halo import Halo, agent_lines
from minerva_bus.world.services import Device

LEFT: Final = "~left"
"""The name in the saved data of a region's checkpoint of agents that have left after a frame."""

OF_ALL: Final = "~kept"
"""The name of what services have saved of all agents, in the checkpoint of a run that continues."""


class NearbyServices:
    """The services with a halo, in one region.

    `send` is called with the events for agents that have moved to other regions. `views` are what
    the services see, and `answered` the events of the last frame by service, with the places of
    their receivers. `running` is the member whose code runs between two frames.
    """

    def __init__(
        self,
        number: int,
        partition: Partition,
        members: Iterable[Member],
        last: Sequence[m.ViewShown] = (),
        own: Units | None = None,
        saved: Mapping[str, m.Saved] | None = None,
    ) -> None:
        """`last` are the last views of a run that continues, with the region's `own` part.

        `saved` are the data of the checkpoint with which a run, or a region, continues.
        """
        saved = saved or {}
        self.send: Callable[[Sequence[Replies]], None] = lambda replies: None
        self.halos: dict[str, Halo] = {}
        self.answered: Mapping[str, Sequence[PlacedEvent]] = {}
        self.running: Member | None = None
        self.number = number
        self._members: dict[str, Member] = {}
        self._asking: list[str] = []
        members = [*members]
        near = halo_services(partition, [member.service for member in members])
        for member in members:
            service = member.service
            if service is None or service.halo is None or service not in near:
                continue
            self._members[member.name] = member
            if service.halo.kept:
                self._asking.append(member.name)
            for drawn in member.hello().draws:
                halo = self.halos.get(drawn, service.halo)
                self.halos[drawn] = halo.joined(service.halo) or halo
        kept = saved.get(OF_ALL) or kept_by(saved, self._asking)
        self.views = NearbyViews(number, self.halos, last, own, kept)
        self._left = frozenset(saved.get(LEFT) or ())
        self._movers: frozenset[int] | None = None
        self._moving: Mapping[str, int] = {}
        self._replies: dict[tuple[int, int], Replies] = {}
        self._ready: dict[str, m.TickReply] = {}

    @property
    def names(self) -> frozenset[str]:
        """The names of the services."""
        return frozenset(self._members)

    @property
    def kept(self) -> dict[str, str]:
        """What services have saved of the region's agents, for others that are shown these."""
        saved = {name: reply.saved for name, reply in self._ready.items()}
        return kept_by(saved, self._asking)

    def moved(self, moving: Mapping[str, int]) -> None:
        """Note the regions of agents that leave this one after a frame."""
        self._moving = moving if self._members else {}
        self._left = frozenset(self._moving)

    def take(self, frame: int, shown: Mapping[int, HaloPart], movers: Iterable[int] | None) -> None:
        """Assemble the views of a frame from what each region shows.

        `movers` are the regions that have sent agents to this one, whose replies the next frame
        needs; None if they have arrived. Raises ProtocolError for replies of others.
        """
        if not self._members:
            return
        self._replies = {key: each for key, each in self._replies.items() if key[0] > frame}
        self._movers = None if movers is None else frozenset(movers)
        for each in self._replies.values():
            self._check_expected(each)
        self.views.take(frame, shown)

    def receive(self, replies: Replies) -> bool:
        """Accept replies of another region; returns False if they have arrived before."""
        key = replies.frame, replies.source
        if replies.frame <= self.views.frame or key in self._replies:
            return False
        self._check_expected(replies)
        self._replies[key] = replies
        return True

    def _check_expected(self, replies: Replies) -> None:
        is_current = self._movers is not None and replies.frame == self.views.frame + 1
        if is_current and replies.source not in (self._movers or ()):
            raise ProtocolError(f"replies of region {replies.source}, which has sent no agents")

    @property
    def arrived(self) -> list[Replies]:
        """The replies for frames that have not begun."""
        return [replies for _, replies in sorted(self._replies.items(), key=lambda item: item[0])]

    def lacks(self, frame: int) -> list[int]:
        """The regions whose replies for a frame have not arrived."""
        return [each for each in sorted(self._movers or ()) if (frame, each) not in self._replies]

    def answer(self, frame: int, *, last: bool = False) -> None:
        """Let the services answer for a frame, before the replies of others are awaited.

        `last`: they generate nothing any more, but agents that have moved take along what is saved.
        """
        if any(member.world is None for member in self._members.values()):
            return  # The first frame: no agent has moved yet.
        if all(name in self._ready and self._ready[name].frame == frame for name in self._members):
            return
        answered: dict[str, list[PlacedEvent]] = {}
        targets = sorted({*self._moving.values()})
        events, kept = ({to: dict[str, Any]() for to in targets} for _ in range(2))
        ask = self._saving if last else self._asked
        replies = answers_of(self._members, lambda member: ask(member, frame))
        for name, reply in sorted(replies.items()):
            self.running = self._members[name]
            check_saved(name, reply.saved)
            answered[name] = [self._placed(name, event) for event in reply.events]
            here, away = self._divided(answered[name])
            saved, texts = parted(reply.saved, self._left, self._moving)
            self._ready[name] = replace(reply, events=here, saved=saved)
            for to in targets:
                events[to][name] = tuple(away.get(to, ()))
                if to in texts:
                    kept[to][name] = agent_lines(texts[to])
        self.running = None
        self.views.all_seen()
        self._moving, self.answered = {}, answered
        if targets:
            self.send([Replies(frame, self.number, to, events[to], kept[to]) for to in targets])

    def _asked(self, member: Member, frame: int) -> Sequence[Answer]:
        self._see(member)
        return received(member, m.TickRequest(frame))

    def _saving(self, member: Member, frame: int) -> Sequence[Answer]:
        self._see(member)
        assert member.service is not None
        return (m.TickReply(member.name, frame, (), saved_by(member.service)),)

    def _see(self, member: Member) -> None:
        self.running = member
        for view, own in self.views.unseen(member.hello().draws):
            assert isinstance(member.service, Device)
            member.service.own = own
            member.service.others = self.views.kept(member.name)
            received(member, view)

    def settle(self, frame: int) -> None:
        """Let the services know what others have saved of agents that arrive with a frame."""
        for name, member in sorted(self._members.items()):
            if name in self._ready:  # Otherwise no agent has moved yet.
                self._ready[name] = self._with_arriving(member, self._arriving(frame))

    def _arriving(self, frame: int) -> list[Replies]:
        return [each for each in self.arrived if each.frame == frame]

    @property
    def left(self) -> dict[str, Any]:
        """The agents that have left, as saved data of a checkpoint, and what is kept of all."""
        if not self._members:
            return {}
        of_all = {OF_ALL: dict(kept)} if (kept := self.views.kept_of_all) else {}
        return {LEFT: dict.fromkeys(self._left, 0), **of_all}

    def figures(self) -> dict[str, int | float]:
        """The numbers that the services report, which are added up over all regions."""
        every = [item for each in self._members.values() for item in each.figures().items()]
        return {name: value for name, value in every if type(value) in (int, float)}  # pyright: ignore

    def _placed(self, name: str, event: AnyEvent) -> PlacedEvent:
        """An event, or a batch, for the agents that this region had; with their places."""
        receivers = _receivers(event)
        own_agents = self.views.own
        if receivers is None or len(receivers) != len(event) or own_agents is None:
            raise WorldStopped(
                f"regions: halo = true: {name} has sent an {event.type} that is not for one agent,"
                " or not in the frame after a view; expected events for single agents about the"
                " view of the last frame, or halo = false"
            )
        places = own_agents.places
        rows: NDArray[np.intp] = own_agents.ids.rows_of(receivers)
        own = np.flatnonzero(rows >= 0)
        event = event.take(own) if isinstance(event, Events) and len(own) < len(rows) else event
        return PlacedEvent(taken(places, rows[own]), event)

    def _divided(
        self, placed: Iterable[PlacedEvent]
    ) -> tuple[tuple[AnyEvent, ...], dict[int, list[AnyEvent]]]:
        """The events for agents that are here, or gone, and those for other regions."""
        here: list[AnyEvent] = []
        away: dict[int, list[AnyEvent]] = {}
        moving, targets = Ids.of([*self._moving]), np.array([*self._moving.values()], np.intp)
        for each in placed:
            if not each.places:
                continue
            event = each.event
            receivers = _receivers(event)
            assert receivers is not None
            rows = moving.rows_of(receivers) if self._moving else np.full(len(receivers), -1)
            to = np.where(rows >= 0, targets[rows], self.number) if self._moving else rows
            stays = _taken(event, np.flatnonzero((rows < 0) | (to == self.number)))
            here += stays
            for region in {*self._moving.values()}:
                away.setdefault(region, []).extend(_taken(event, np.flatnonzero(to == region)))
        return tuple(here), away

    # --- in a frame ---

    def deliver(self, member: Member, message: m.ToMember | m.Readings) -> Iterable[Answer]:
        """Deliver a message of this region to one of the services; returns its answers."""
        match message:
            case m.ViewShown():  # The view of this region alone.
                return ()
            case m.TickRequest(frame):
                self.answer(frame)
                others = self._arriving(frame)
                ready = self._ready[member.name] = self._with_arriving(member, others)
                events = [each.events[member.name] for each in others]
                return (replace(ready, events=_joined(ready.events, *events)),)
            case m.Stop():
                self._see(member)
                self.running = None
                return received(member, message)
            case _:
                return received(member, message)

    def _with_arriving(self, member: Member, others: Iterable[Replies]) -> m.TickReply:
        """The reply of a service that knows what others have saved of agents that arrive."""
        ready, texts = self._ready[member.name], dict[str, str]()
        for each in others:
            texts |= texts_of({AGENTS: each.kept.get(member.name, "")})
        saved = ready.saved
        if texts:
            saved = with_texts(saved, texts_of(saved) | texts)
        if saved is not None and member.service is not None and (texts or self._left):
            restore(member.service, saved)
        return replace(ready, saved=saved)


def _receivers(event: AnyEvent) -> Ids | None:
    return event.receivers if isinstance(event, Events) else Ids.of(event.receivers)


def _taken(event: AnyEvent, rows: NDArray[np.intp]) -> Sequence[AnyEvent]:
    if not len(rows):
        return ()
    return (event.take(rows),) if isinstance(event, Events) else (event,)


def _joined(*parts: Sequence[AnyEvent]) -> tuple[AnyEvent, ...]:
    """The events of several regions; a batch if each of them has one."""
    present = [each for events in parts for each in events]
    batches = [each for each in present if isinstance(each, Events)]
    whole = Events.concatenated(batches) if batches and len(batches) == len(present) else None
    return tuple(present) if whole is None else (whole,)
