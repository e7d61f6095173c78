"""Client of a running world for `list`, `pub` and `echo`: questions and frame records."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any, Self

import zenoh

from minerva_bus.errors import BusError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.runtime.asking import AskingOperator, ask, question_key
from minerva_bus.runtime.diagnosis import not_let_in
from minerva_bus.runtime.inbox import Watch
from minerva_bus.runtime.session import open_client
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.keys import COORDINATOR, Keys
from minerva_bus.wire.vocabulary_codec import read_vocabulary

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
