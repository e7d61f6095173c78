"""A hub without a coordinator: a script sends bytes on the keys of a world and reads the replies.

The conformance suite plays the coordinator with it. Several worlds may share a hub, because each
has keys of its own.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import time
from typing import Any, Final, Self

import zenoh

from minerva_bus.runtime.session import closed_in_time, open_hub
from minerva_bus.runtime.session_inbox import KeyedSample, Watch, keyed_sample
from minerva_bus.wire.keys import COORDINATOR, Keys

_BLOCK: Final = zenoh.CongestionControl.BLOCK


class ScriptInterrupted(KeyboardInterrupt):
    """The user has interrupted the scripts of a hub."""


class ScriptedHub:
    """The session of a hub; a context manager that closes it. `endpoint` is for members.

    `interrupted`: scripts end, because the user does not want to wait for them.
    """

    def __init__(self) -> None:
        self.interrupted = False

    def __enter__(self) -> Self:
        self.session, self.endpoint = open_hub("conformance")
        self._closing = closed_in_time(self.session)
        self._closing.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.__exit__(None, None, None)


class ScriptedWorld:
    """The coordinator's place in one world, which has one member; a context manager.

    It receives what the member publishes, and its token.
    """

    def __init__(self, hub: ScriptedHub, world: str, member: str) -> None:
        self.keys = Keys(world)
        self.member = member
        self._hub = hub
        self._session = hub.session
        self._watch = Watch()
        self._tokens: dict[str, Any] = {}
        self._declared: list[Any] = []

    def __enter__(self) -> Self:
        session, keys, member, watch = self._session, self.keys, self.member, self._watch
        liveliness = session.liveliness()
        self._declared = [
            session.declare_subscriber(keys.sent_by(member), watch.handler()),
            session.declare_subscriber(f"{keys.base}/topic/*/{member}", watch.handler()),
            liveliness.declare_subscriber(keys.alive(member), watch.handler(), history=True),
        ]
        return self

    def __exit__(self, *_: object) -> None:
        for declared in (*self._declared, *self._tokens.values()):
            declared.undeclare()

    def put(self, key: str, data: bytes) -> None:
        """Publish bytes on a key, such as `to/member`, of this world."""
        self._session.put(f"{self.keys.base}/{key}", data, congestion_control=_BLOCK)

    def next(self, until: float) -> KeyedSample | None:
        """The member's next message or change of its token; None at the monotonic time `until`.

        Raises ScriptInterrupted.
        """
        self.check()
        sample = self._watch.get(until)
        return None if sample is None else keyed_sample(sample)

    def check(self) -> None:
        """Raise ScriptInterrupted if the hub's scripts are to end."""
        if self._hub.interrupted:
            raise ScriptInterrupted

    def appear(self, epoch: int) -> None:
        """Declare the tokens of a coordinator of this epoch."""
        self.hold(self.keys.alive(COORDINATOR))
        self.hold(self.keys.epoch(epoch))

    def vanish(self) -> None:
        """Remove the coordinator's tokens."""
        for key in list(self._tokens):
            self.release(key)

    def hold(self, key: str) -> None:
        """Declare a liveliness token."""
        self._tokens[key] = self._session.liveliness().declare_token(key)

    def release(self, key: str) -> None:
        """Remove a liveliness token."""
        self._tokens.pop(key).undeclare()

    @staticmethod
    def now() -> float:
        """The clock of `next`, in seconds."""
        return time.monotonic()
