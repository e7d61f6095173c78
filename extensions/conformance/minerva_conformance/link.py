"""A member under test: its process, and the messages that it exchanges with the coordinator."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import MinervaError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.runtime.session_inbox import KeyedSample
from minerva_bus.wire.codec import Decoder, stamped
from minerva_conformance.launching import RunningMember, StartMember
from minerva_conformance.proxy import Proxy
from minerva_conformance.scripted_world import ScriptedWorld
from minerva_conformance.world import MEMBER, VOCABULARY, MemberRole

FIRST_EPOCH: Final = 5
POLL_SECONDS: Final = 0.2
"""Interval in seconds between checks whether the member still runs, and for an interruption."""

GONE_SECONDS: Final = 0.5
"""Seconds in which the last messages of a member arrive whose token has vanished."""


@dataclass(frozen=True, slots=True)
class TimeLimits:
    """Time limits in seconds: until a member has joined, for an answer, and until it has ended."""

    join: float = 30.0
    answer: float = 10.0
    end: float = 30.0


class CaseFailure(MinervaError):
    """The member has violated a requirement."""

    def __init__(self, problem: str, expected: Sequence[str] = (), received: Sequence[str] = ()):
        super().__init__(problem)
        self.expected = tuple(expected)
        self.received = tuple(received)


class NotJoined(MinervaError):
    """The member has not come as far as the case begins."""


class MemberLink:
    """Starts a member's process, sends it bytes and reads its messages.

    `role` is None for the probe of a member without a role; `cuttable`: the member connects through
    a proxy. `sent` lists as text what was sent, and what happened.
    """

    def __init__(
        self,
        stage: ScriptedWorld,
        start: StartMember,
        endpoint: str,
        role: MemberRole | None,
        limits: TimeLimits,
        *,
        cuttable: bool,
    ) -> None:
        self.sent: list[str] = []
        self.epoch = FIRST_EPOCH
        self.stage = stage
        self.limits = limits
        self._present = False
        self._decoder = Decoder(VOCABULARY)
        self._closing = ExitStack()
        self._proxy: Proxy | None = None
        if cuttable:
            port = int(endpoint.rpartition(":")[2])
            self._proxy = self._closing.enter_context(Proxy(port, lambda: 0.0))
            endpoint = f"tcp/127.0.0.1:{self._proxy.port}"
        environment = {
            "MINERVA_WORLD": stage.keys.world,
            "MINERVA_CONNECT": endpoint,
            "MINERVA_NAME": MEMBER,
            **({} if role is None else {"MINERVA_ROLE": role.value}),
        }
        self._start = lambda: start(environment)
        self.process: RunningMember = self._start()

    def close(self) -> None:
        """End the member's process."""
        self.process.kill()
        self._closing.close()

    def start_again(self) -> None:
        """Kill the process, wait until its token has vanished and start another one."""
        self.process.kill()
        self.await_absence()
        self.sent.append("(its process is killed and started again)")
        self.process = self._start()

    def cut(self) -> None:
        """Cut the connection of a member that connects through a proxy."""
        if self._proxy is not None:
            self._proxy.cut()

    # --- waiting ---

    def await_token(self, seconds: float) -> None:
        """Wait for the member's token. Raises NotJoined and CaseFailure."""
        until = self.stage.now() + seconds
        while not self._present:
            sample = self._next_sample(until)
            if sample is not None:
                self.message(sample)
            elif self.stage.now() >= until:
                raise NotJoined(f"no token alive/{MEMBER} within {seconds:g} s")
            elif (code := self.process.code(0.0)) is not None:
                raise NotJoined(f"it ended with exit code {code} before it declared its token")

    def await_absence(self) -> None:
        """Wait until the member's token has vanished. Raises CaseFailure."""
        until = self.stage.now() + self.limits.end
        while self._present:
            sample = self._next_sample(until)
            if sample is not None:
                self.message(sample)
            elif self.stage.now() >= until:
                raise CaseFailure("it has not undeclared its token")

    def exit_code(self) -> int | None:
        """The member's exit code, once it has ended; None if it does not end in time."""
        until = self.stage.now() + self.limits.end
        while (code := self.process.code(POLL_SECONDS)) is None and self.stage.now() < until:
            self.stage.check()
        return code

    # --- messages ---

    def put(self, key: str, data: bytes, shown: str) -> None:
        """Send bytes on a key of the world, listed as `shown` unless that is empty."""
        if shown:
            self.sent.append(f"{key}: {shown[:300]}")
        self.stage.put(key, data)

    def next_message(self, seconds: float) -> m.FromMember | m.Readings | None:
        """The member's next message, without its metrics; None after `seconds`.

        Raises CaseFailure for one that cannot be read.
        """
        until = self.stage.now() + seconds
        while True:
            sample = self._next_sample(until)
            message = None if sample is None else self.message(sample)
            if message is not None:
                return message
            if self.stage.now() >= until:
                return None
            if not self._present:  # Its token may have overtaken its last messages.
                until = min(until, self.stage.now() + GONE_SECONDS)

    def _next_sample(self, until: float) -> KeyedSample | None:
        """The next sample; None at `until`, and often before it, so that it can be interrupted."""
        return self.stage.next(min(until, self.stage.now() + POLL_SECONDS))

    def message(self, sample: KeyedSample) -> m.FromMember | m.Readings | None:
        """The message in a sample; None for a change of the token, and for metrics."""
        keys = self.stage.keys
        if sample.key == keys.alive(MEMBER):
            self._present = sample.there
            return None
        try:
            if keys.kind(sample.key) == "topic":
                return self._decoder.readings(sample.key.split("/")[3], MEMBER, sample.data)
            epoch, body = stamped(sample.data)
            message = self._decoder.from_member(MEMBER, body)
        except (ProtocolError, SceneError) as error:
            raise CaseFailure(
                f"an invalid message: {error}", (), [sample.data.hex()[:400]]
            ) from None
        if epoch != self.epoch:
            raise CaseFailure(f"a message of epoch {epoch} instead of {self.epoch}")
        return None if isinstance(message, m.MemberMetrics) else message
