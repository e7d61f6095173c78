"""A member without rules of its own: a script sends bytes to a coordinator and reads its messages.

The conformance suite of coordinators plays members with it.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from contextlib import ExitStack
from typing import Any, Final, Self

import zenoh

from minerva_bus.runtime.session import closed_in_time, open_client
from minerva_bus.runtime.session_inbox import KeyedSample, Watch, keyed_sample
from minerva_bus.wire.keys import COORDINATOR, Keys

_BLOCK: Final = zenoh.CongestionControl.BLOCK
_QUESTION_SECONDS: Final = 10.0


class ScriptedMember:
    """The place of a member in a world that runs at an endpoint; a context manager.

    Raises BusError if nothing answers at the endpoint.
    """

    def __init__(self, endpoint: str, world: str, name: str) -> None:
        self.keys = Keys(world)
        self.name = name
        self._endpoint = endpoint
        self._watch = Watch()
        self._closing = ExitStack()
        self._declared: list[Any] = []
        self._token: Any = None

    def __enter__(self) -> Self:
        self._session = open_client(self.name, self._endpoint)
        self._closing.enter_context(closed_in_time(self._session))
        keys, handler = self.keys, self._watch.handler
        heard = (f"{keys.base}/to/{self.name}", keys.all, keys.tick, keys.evolve, keys.record)
        self._declared = [self._session.declare_subscriber(key, handler()) for key in heard]
        liveliness = self._session.liveliness()
        for key in (keys.alive(COORDINATOR), f"{keys.base}/epoch/*"):
            self._declared.append(liveliness.declare_subscriber(key, handler(), history=True))
        return self

    def __exit__(self, *_: object) -> None:
        self.vanish()
        for declared in self._declared:
            declared.undeclare()
        self._closing.close()

    def appear(self) -> None:
        """Declare the member's token."""
        self._token = self.declare_token(f"alive/{self.name}")

    def declare_token(self, rest: str) -> Any:
        """Declare a token on a key of the world; it lasts until the session ends."""
        token = self._session.liveliness().declare_token(f"{self.keys.base}/{rest}")
        self._declared.append(token)
        return token

    def vanish(self) -> None:
        """Undeclare it."""
        if self._token is not None:
            self._declared.remove(self._token)
            self._token.undeclare()
            self._token = None

    def put(self, rest: str, data: bytes) -> None:
        """Publish bytes on a key of the world."""
        self._session.put(f"{self.keys.base}/{rest}", data, congestion_control=_BLOCK)

    def next(self, until: float) -> KeyedSample | None:
        """The next message or change of a token; None at the monotonic time `until`."""
        sample = self._watch.get(until)
        return None if sample is None else keyed_sample(sample)

    def ask(self, question: bytes) -> bytes:
        """The answer to a question of people; empty if there is none."""
        replies = self._session.get(self.keys.control, payload=question, timeout=_QUESTION_SECONDS)
        return next((reply.ok.payload.to_bytes() for reply in replies if reply.ok), b"")
