"""Clients of a running world: an operator, who controls it by questions, and frame records.

Commands, windows, pages and tools show the same facts about a world's status; only their form
differs.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from typing import Any, Final, Self

import zenoh

from minerva_bus.errors import BusError, MisuseError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.runtime.endpoints import not_let_in
from minerva_bus.runtime.session import open_client
from minerva_bus.runtime.session_inbox import Watch
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.keys import ANY_WORLD, COORDINATOR, Keys, asking_key, control_key
from minerva_bus.wire.plain import as_int, as_list, as_map, as_text, pack, unpack
from minerva_bus.wire.status_codec import read_lines, read_orders, read_series, read_status
from minerva_bus.wire.strings_codec import plain_event
from minerva_bus.wire.vocabulary_codec import read_vocabulary
from minerva_bus.world.operator import (
    CollectedSeries,
    LogLine,
    MemberStatus,
    OrderStatus,
    WorldStatus,
)


def question_key(world: str, own: Credentials | None) -> str:
    """Key for questions to a world by name; an empty name stands for any world at the endpoint."""
    name = world or ANY_WORLD
    if own is None:
        return control_key(name)
    return control_key(name, own.name) if own.operates else asking_key(name, own.name)


def ask(
    session: zenoh.Session, key: str, question: str, seconds: float, details: Mapping[str, Any]
) -> Mapping[str, Any] | None:
    """The world's answer to a question, or None if none arrives within `seconds`.

    Raises BusError if the world rejects the question.
    """
    if "event" in details:
        details = {**details, "event": plain_event(details["event"])}
    try:
        payload, sender = pack({"ask": question, **details}), str(session.zid())
        replies = session.get(key, payload=payload, attachment=sender, timeout=seconds)
    except zenoh.ZError as error:
        raise BusError(f"the question cannot be sent: {error}") from None
    # A key for any world may have several answers; the first one counts.
    for reply in replies:
        if reply.ok is not None:
            answer = as_map(unpack(reply.ok.payload.to_bytes()), "an answer")
            if "error" in answer:
                raise BusError(as_text(answer["error"], "an error"))
            return answer
    return None


class AskingOperator:
    """Operates a world through questions, as commands, windows and pages do.

    Args:
        ask: sends a question and returns the coordinator's answer.
        by: name of the person or window that gives orders.

    """

    def __init__(self, ask: Callable[..., Mapping[str, Any]], by: str = "") -> None:
        self._ask = ask
        self._by = by

    def named(self, by: str) -> AskingOperator:
        """The same operator for another person; an empty name leaves that of the process."""
        return AskingOperator(self._ask, by or self._by)

    def status(self, since: int = 0) -> WorldStatus:
        """State of the world, with the log entries since a number."""
        return read_status(self._ask("status", since=since).get("status"))

    def fragment(self, agent: str) -> str:
        """The text of one agent."""
        return as_text(self._ask("fragment", agent=agent).get("fragment"), "the fragment")

    def order(self, event: AnyEvent) -> int:
        """Send an event to the world; returns the number of the order.

        Raises MisuseError for anything but events, such as its type.
        """
        if not isinstance(event, Event | Events):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise MisuseError(f"expected an event, such as eSun(heat=0.5), not {event!r:.60}")
        answer = self._ask("order", event=event, by=self._by)
        return as_int(answer.get("number", 0), "the number of an order")

    def pause(self) -> None:
        """Pause the world until `resume` or `step`."""
        self._ask("pause", by=self._by)

    def resume(self) -> None:
        """Resume a paused world."""
        self._ask("resume", by=self._by)

    def step(self, frames: int = 1) -> None:
        """Run a number of frames, then pause."""
        self._ask("step", frames=frames, by=self._by)

    def seek(self, frame: int) -> None:
        """Continue the replay of a record at a frame."""
        self._ask("seek", frame=frame)

    def set_rate(self, rate: float) -> None:
        """Set the frames per second; 0: as many as possible."""
        self._ask("rate", rate=rate, by=self._by)

    def restart(self, member: str) -> None:
        """Restart a process of the world file."""
        self._ask("restart", member=member, by=self._by)

    def stack(self, member: str) -> None:
        """Write the stacks of a process of the world file to its log."""
        self._ask("stack", member=member)

    def drain(self, member: str) -> tuple[str, ...]:
        """Move a host's agents to other hosts; returns the names of these hosts."""
        hosts = as_list(self._ask("drain", member=member, by=self._by).get("to"), "hosts")
        return tuple([as_text(host, "a host") for host in hosts])

    def logs(self, since: int = 0, member: str = "") -> tuple[LogLine, ...]:
        """Lines that members printed, and warnings about them."""
        return read_lines(self._ask("logs", since=since, member=member).get("lines"))

    def orders(self, since: int = 0) -> tuple[OrderStatus, ...]:
        """Orders of people that have changed."""
        return read_orders(self._ask("orders", since=since).get("orders"))

    def series(self) -> tuple[CollectedSeries, ...]:
        """Collected series."""
        return read_series(self._ask("series").get("series"))


ANSWER_WITHIN = 5.0
QUIET_SECONDS = 0.5
"""A watcher of records asks for the state of a world that has sent none for this time."""
LOST_SECONDS = 5.0
"""It gives up a world that has not answered for this time."""


class Client:
    """Connection to a world at an endpoint, by its name; without a name, to any world there.

    `own` are the credentials of the caller. Raises BusError if no world answers.
    """

    def __init__(self, endpoint: str, world: str = "", own: Credentials | None = None) -> None:
        self._endpoint = endpoint
        self._own = own
        self._session = open_client("client" if own is None else own.name, endpoint, own=own)
        self.operator = AskingOperator(self.ask)
        self._control = question_key(world, own)
        try:
            self.world = world or self.operator.status().world
        except BaseException:  # Otherwise its threads keep the process alive.
            self._session.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._session.close()

    def ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        """The world's answer to a question. Raises BusError if it is missing or an error."""
        answer = ask(self._session, self._control, question, ANSWER_WITHIN, details)
        if answer is not None:
            return answer
        name = f"no world {self.world!r}" if getattr(self, "world", "") else "no world"
        raise BusError(
            f"{name} answers at {self._endpoint} (minerva list shows who runs here)"
            f"{not_let_in(self._own)}"
        )

    def vocabulary(self) -> Vocabulary:
        """The world's vocabulary."""
        return read_vocabulary(self.ask("vocabulary").get("vocabulary"))

    def records(self) -> Iterator[m.FrameRecord]:
        """The record of each frame from now on, until the world ends.

        Raises BusError if the world has not answered for `LOST_SECONDS`.
        """
        keys, inbox = Keys(self.world), Watch()
        decoder = Decoder(self.vocabulary())
        coordinator = keys.alive(COORDINATOR)
        session = self._session
        # The coordinator's is declared before that of the records, so that the end of the world
        # cannot be missed. `with`, because a caller may stop early and a record may be unreadable.
        with (
            session.liveliness().declare_subscriber(coordinator, inbox.handler()),
            session.declare_subscriber(keys.record, inbox.handler()),
        ):
            heard = time.monotonic()
            while True:
                item: Any = inbox.get(time.monotonic() + QUIET_SECONDS)
                if not isinstance(item, zenoh.Sample):
                    # A paused world sends no records, and the token of a killed one may stay.
                    heard = self._heard(heard)
                    continue
                heard = time.monotonic()
                if str(item.key_expr) == coordinator:
                    # No record marks the end of the records; the coordinator's token does.
                    if item.kind == zenoh.SampleKind.DELETE:
                        return
                    continue
                yield self._record(decoder, item)

    def _heard(self, before: float) -> float:
        """The time of the last answer, as of now; `before` is that of the one before."""
        try:
            self.operator.status()
        except BusError:
            if time.monotonic() - before > LOST_SECONDS:
                raise
            return before
        return time.monotonic()

    def _record(self, decoder: Decoder, sample: zenoh.Sample) -> m.FrameRecord:
        try:
            return decoder.record(sample.payload.to_bytes())
        except (ProtocolError, SceneError) as error:
            raise BusError(f"the record of {self.world!r} cannot be read: {error}") from None


# --- its status in words ---

LONG_WAIT: Final = 0.5
"""Seconds after which it is shown that a frame waits for members; shorter waits are normal."""


def awaited(status: WorldStatus) -> tuple[str, ...]:
    """The members for which the frame has waited for LONG_WAIT seconds or more."""
    return status.waiting if status.waited >= LONG_WAIT else ()


def activity(status: WorldStatus, most: int = 4) -> str:
    """What the world does: it runs, is paused, or waits for members, of which `most` are named."""
    if names := awaited(status):
        others = " …" if len(names) > most else ""
        return f"waiting for {', '.join(names[:most])}{others}"
    # A paused world may still run the frames of a step.
    return "paused" if status.paused and not status.left else "running"


def types_of(member: MemberStatus) -> str:
    """The kinds that a member hosts, and the event types that it generates and draws."""
    return " ".join([*member.kinds, *member.generates, *member.draws])


def status_object(status: WorldStatus) -> dict[str, Any]:
    """The status as a JSON object, without its log entries."""
    return {**asdict(status), "happenings": []}
