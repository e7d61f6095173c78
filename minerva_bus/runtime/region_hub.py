"""The hub of a region: hosts in processes of their own evolve agents of the region.

It is the coordinator of any world, around the frame algorithm of the region, with two differences:
what arrives is handled in the loop of the region's process, and members without a process of their
own, such as generators, are in it.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Final

import zenoh

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.runtime.admission import ListenConfig
from minerva_bus.runtime.control import COMMANDS
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.direct import Deliver, DirectTransport, deliver
from minerva_bus.runtime.inbox import HubInbox, TimerTick
from minerva_bus.runtime.monitor import STATUS_EVERY
from minerva_bus.runtime.runner import Notice
from minerva_bus.runtime.system import REAL, Timer
from minerva_bus.runtime.waiting import Deadlines
from minerva_bus.runtime.watchers import Started, Watchers
from minerva_bus.wire.keys import last_part
from minerva_bus.wire.limits import Limits

QUESTIONS: Final = {"status": COMMANDS["status"]}
"""All that a hub answers: whoever operates the world asks its coordinator."""

EPOCHS_PER_SECOND: Final = 1000
"""A region may be restarted in the second in which it was started."""


@dataclass(frozen=True, slots=True)
class HubItem:
    """Something that has arrived at the hub of this process."""

    item: Any


@dataclass(frozen=True, slots=True)
class HubConfig:
    """The hub of a region: where it listens, and what it grants its hosts.

    `late` is called with the name of a host that has not answered in time, and the seconds since;
    `joined` with the name of one that joins; `listening` with the endpoint for hosts of this
    machine.
    """

    where: ListenConfig
    deadlines: Deadlines
    limits: Limits
    late: Callable[[str, float], None]
    joined: Callable[[str], None]
    listening: Callable[[str], None]


class RegionHub:
    """Runs the frame algorithm of a region with members here and hosts on the bus.

    `put` receives a `HubItem` for all that arrives, in any thread; the loop of the process passes
    these to `take`.
    """

    def __init__(
        self,
        config: HubConfig,
        put: Callable[[HubItem], None],
        algorithm: FrameAlgorithm,
        members: Iterable[Member],
        observe: Callable[[Notice], None],
        deliver: Deliver = deliver,
    ) -> None:
        members = [*members]
        self._names = sorted(member.name for member in members)
        self._coordinator = Coordinator(
            algorithm.world,
            Watchers(
                # The log limits the number of lines, and has those of the hub, too.
                said=lambda member, text, details: observe(s.Notify(member, text, details)),
                status=lambda _: None,
                listening=config.listening,
                stalled=config.late,
                came=config.joined,
            ),
            where=config.where,
            deadlines=config.deadlines,
            limits=config.limits,
            algorithm=algorithm,
            sinks=[lambda notice: None if isinstance(notice, s.Notify) else observe(notice)],
            direct=DirectTransport(members, deliver=deliver),
            inbox=_SharedInbox(put),
            epoch=int(EPOCHS_PER_SECOND * REAL.time()),
            commands=QUESTIONS,
        )
        self._open = ExitStack()

    @property
    def ended(self) -> s.Ended | None:
        """The end of the world, when all members have reported."""
        return self._coordinator.runner.ended

    def start(self) -> None:
        """Open the hub, and let the members of this process join. Raises BusError."""
        coordinator = self._coordinator
        entered = coordinator.admission.session(coordinator.inbox.put)
        session, endpoint = self._open.enter_context(entered)
        self._open.callback(coordinator.inbox.close)
        for declaration in coordinator.declare(session):
            self._open.callback(declaration.undeclare)
        coordinator.watchers.listening(endpoint)
        for name in self._names:
            self.handle(s.Appeared(name))

    def outlook(self, member: str) -> str:
        """What follows if a frame waits for a host any longer, and when; empty: nothing."""
        return self._coordinator.outlook(member)

    def handle(self, stimulus: s.Stimulus) -> None:
        """Process a stimulus; hosts on the bus answer later."""
        self._coordinator.runner.handle(stimulus)

    def take(self, arrived: HubItem) -> None:
        """Process what has arrived."""
        item = arrived.item
        if _sender(item) in self._names:
            self._refuse_namesake(item)
            return
        if isinstance(item, s.Appeared):  # The hub does not know earlier that its process starts.
            self._coordinator.take(Started(item.member))
        self._coordinator.take(item)

    def _refuse_namesake(self, item: Any) -> None:
        """Refuse a host with the name of a member in this process, which has no token."""
        if isinstance(item, s.Appeared):
            reason = "the region itself runs a member of this name; choose another one (--name)"
            self._coordinator.transport.send(item.member, m.Refused(reason))

    def close(self) -> None:
        """Close the hub."""
        self._open.close()


class _SharedInbox(HubInbox):
    """The inbox of a hub, whose items are put into the queue of its process."""

    indirect = False

    def __init__(self, put: Callable[[HubItem], None]) -> None:
        super().__init__(STATUS_EVERY)
        self._put = put
        self._timer: Timer | None = None

    def open(self, session: zenoh.Session, key: str, wake_key: str = "") -> list[Any]:
        """Subscribe to the keys of hosts."""
        self._timer = self._system.every(self._every, lambda: self.put(TimerTick()))
        return [session.declare_subscriber(key, self.handler(_message))]

    def put(self, item: Any) -> None:
        """Pass an item on."""
        self._put(HubItem(item))

    def close(self) -> None:
        """Stop the timer."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()


def _sender(item: Any) -> str:
    """The host from which an item of the inbox is; "" for other items."""
    match item:
        case (str() as name, bytes()):
            return name
        case s.Appeared(name) | s.Vanished(name):
            return name
        case _:
            return ""


def _message(sample: zenoh.Sample) -> tuple[str, bytes]:
    return last_part(str(sample.key_expr)), sample.payload.to_bytes()
