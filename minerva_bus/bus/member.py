"""A member's process on the bus: hears, lets its `Participant` answer, and sends."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zenoh

from minerva_bus.bus.inbox import Inbox
from minerva_bus.bus.session import open_client
from minerva_bus.errors import BusError, MinervaError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame.participant import Participant, Refusal
from minerva_bus.grammar.events import Event
from minerva_bus.protocol.codec import Decoder, encode
from minerva_bus.protocol.keys import COORDINATOR, Keys, checked_name, last_part
from minerva_bus.world.services import Device, Generator

GREETING = 10.0
NAME_FREE = 2.0
WORLD_SEEN = 1.0


@dataclass(frozen=True, slots=True)
class Gone:
    """The coordinator's token is gone."""


@dataclass(frozen=True, slots=True)
class Leave:
    """The member shall leave its world."""


class BusMember:
    """A participant with a Zenoh session of its own."""

    def __init__(
        self, participant: Participant, world: str, endpoint: str, tell: Callable[[str], None]
    ) -> None:
        checked_name(participant.name, "a member")
        self.participant = participant
        self.keys = Keys(world)
        self.inbox = Inbox()
        self._endpoint = endpoint
        self._tell = tell
        self._decoder = Decoder()
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._stop = threading.Event()

    def leave(self) -> None:
        """Leave the world; may be called from a signal handler or another thread."""
        self.inbox.put(Leave())

    def run(self) -> int:
        """Take part until the world ends; the process's exit code.

        Raises BusError where the world cannot be reached and Refusal where it refuses.
        """
        with open_client(self.participant.name, self._endpoint) as session:
            self._find_world(session)
            self._wait_for_name(session)
            declared = self._declare(session)
            try:
                return self._take_part()
            finally:
                self._stop.set()
                if self.participant.service is not None:
                    self.participant.service.close()
                for one in declared:
                    one.undeclare()

    def _find_world(self, session: zenoh.Session) -> None:
        """A coordinator that is there can be seen at once; others would be waited for in vain."""
        key, until = self.keys.alive(COORDINATOR), time.monotonic() + WORLD_SEEN
        while not list(session.liveliness().get(key, timeout=1.0)):
            if time.monotonic() > until:
                raise BusError(
                    f"there is no world {self.keys.world!r} at {self._endpoint};"
                    " is that its name (minerva list)?"
                )
            time.sleep(0.02)

    def _wait_for_name(self, session: zenoh.Session) -> None:
        """A name is free some milliseconds after its last bearer has died."""
        key, until = self.keys.alive(self.participant.name), time.monotonic() + NAME_FREE
        while list(session.liveliness().get(key, timeout=1.0)):
            if time.monotonic() > until:
                raise BusError(
                    f"there is a member {self.participant.name!r} in the world already;"
                    " choose another name (--name)"
                )
            time.sleep(0.02)

    def _declare(self, session: zenoh.Session) -> list[Any]:
        """Subscribers first, then publishers, the token last: so that nothing is missed."""
        name, keys, service = self.participant.name, self.keys, self.participant.service
        listen = [keys.all, keys.to(name), *map(keys.topic, self.participant.topics)]
        if self.participant.hello().ticks:
            listen.append(keys.tick)
        if self.participant.host.kinds:
            listen.append(keys.evolve)
        if isinstance(service, Device) and not service.coupled:
            listen += map(keys.view, service.draws)
        declared: list[Any] = [session.declare_subscriber(k, self.inbox.handler()) for k in listen]
        self._publisher(session, keys.sent_by(name))
        for topic in service.publishes if service is not None else ():
            self._publisher(session, keys.topic(topic, name))
        declared += self._publishers.values()
        declared.append(
            session.liveliness().declare_subscriber(
                keys.alive(COORDINATOR), self.inbox.handler(), history=True
            )
        )
        declared.append(session.liveliness().declare_token(keys.alive(name)))
        return list(reversed(declared))

    def _publisher(self, session: zenoh.Session, key: str) -> None:
        self._publishers[key] = session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )

    def _take_part(self) -> int:
        deadline = time.monotonic() + GREETING
        while True:
            try:
                joined = self.participant.world is not None
                item = self._idle() if joined else self.inbox.get(deadline)
                if item is None:
                    raise BusError(
                        f"the world {self.keys.world!r} does not greet {self.participant.name};"
                        " is that its name (minerva list)?"
                    )
                if not self._handle(item):
                    return 0
            except (Refusal, BusError):
                raise
            except Exception as error:
                self._report_failure(error)
                return 1
            if self.participant.stopped:
                return 0

    def _idle(self) -> Any:
        """Wait for the next item; a view that nothing newer replaces is shown first."""
        item = self.inbox.get(0.0)
        if item is None:
            self.participant.show()
            item = self.inbox.get()
        return item

    def _handle(self, item: Any) -> bool:
        """Deal with one item; False when it is time to go."""
        if isinstance(item, zenoh.Sample):
            return self._heard(item)
        if isinstance(item, Event):
            self._send(self.participant.emitted(item))
            return True
        if isinstance(item, Exception):
            raise item
        self._send(m.Leaving(self.participant.name))
        return False

    def _heard(self, sample: zenoh.Sample) -> bool:
        key = str(sample.key_expr)
        if key == self.keys.alive(COORDINATOR):
            if sample.kind == zenoh.SampleKind.DELETE:
                self._tell(f"{self.participant.name}: the world {self.keys.world!r} is gone")
                return False
            return True
        message = self._decode(key, sample.payload.to_bytes())
        if message is None:
            return True
        joining = self.participant.world is None
        for answer in self.participant.receive(message):
            self._send(answer)
        if joining and self.participant.world is not None:
            self._decoder = Decoder(self.participant.world.vocabulary)
            self._run_freely()
        return True

    def _decode(self, key: str, data: bytes) -> m.ToMember | m.Readings | None:
        parts = key.split("/")
        try:
            if parts[2] == "topic":
                return self._decoder.readings(parts[3], parts[4], data)
            return self._decoder.to_member(data)
        except (ProtocolError, SceneError) as error:
            if self.participant.world is None:
                return None  # Before the welcome nothing with symbols in it can be read.
            if parts[2] != "topic":
                raise  # Without what the coordinator says there is no taking part.
            self._tell(f"{self.participant.name}: from {last_part(key)}: {error}; dropped")
            return None

    def _send(self, message: m.FromMember | m.Readings) -> None:
        name = self.participant.name
        if isinstance(message, m.Readings):
            key = self.keys.topic(message.topic, name)
        else:
            key = self.keys.sent_by(name)
        self._publishers[key].put(encode(message))

    def _report_failure(self, error: Exception) -> None:
        frame = self.participant.frame
        shown = "".join(traceback.format_exception(error))
        problem = (
            str(error) if isinstance(error, MinervaError) else f"{type(error).__name__}: {error}"
        )
        self._send(m.Failed(self.participant.name, frame, problem, shown))

    def _run_freely(self) -> None:
        service = self.participant.service
        if isinstance(service, Generator) and not service.lockstep:
            threading.Thread(target=self._emit_all, args=(service,), daemon=True).start()

    def _emit_all(self, service: Generator) -> None:
        try:
            service.run(self.inbox.put, self._stop)
        except Exception as error:
            self.inbox.put(error)
