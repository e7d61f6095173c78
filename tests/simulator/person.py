"""A person who operates a simulated world, one act after another, as commands do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from minerva_bus.runtime.operator_client import ANSWER_WITHIN, question_key
from minerva_bus.wire.plain import as_map, pack, unpack
from tests.simulator.history import Operation
from tests.simulator.network import Network
from tests.simulator.observing import Asked
from tests.simulator.process import SimulatedProcess
from tests.simulator.sessions import Session
from tests.simulator.timeline import Timeline
from tests.simulator.worlds import NAME

UNPAUSED: Final = Operation(0.5, "resume")
TRIES: Final = 60
SETTLED: Final = 20.0
"""Simulated seconds within which requested frames must have ended in spite of all faults."""

_HALTING: Final = ("pause", "step")


class Person:
    """Executes the acts of a history; then resumes the world. `heard` gets the results."""

    def __init__(
        self,
        timeline: Timeline,
        network: Network,
        acts: tuple[Operation, ...],
        heard: Callable[[Asked], None],
    ) -> None:
        self._timeline = timeline
        self._network = network
        self._heard = heard
        halted = any(act.ask in _HALTING for act in acts)
        # Frames of a last step get time to run before the world is resumed.
        first = Operation(SETTLED, "resume") if acts and acts[-1].ask == "step" else UNPAUSED
        # A person who has paused the world also resumes it; otherwise it would never end.
        self._acts = [*acts, *([first, *[UNPAUSED] * TRIES] if halted else ())]
        self._unpausing = len(acts)
        self._next = 0
        self._key = question_key(NAME, None)
        self._process = SimulatedProcess(
            "person", timeline, network, lambda _: None, lambda _: None
        )
        self._session: Session | None = None

    def begin(self) -> None:
        """Begin with the first act."""
        self._session = self._network.open_client(self._process)
        self._go_on()

    def _go_on(self) -> None:
        if self._next < len(self._acts):
            act = self._acts[self._next]
            self._timeline.after(act.wait, lambda: self._do(act))

    def leave(self) -> None:
        """Stop acting."""
        self._acts = []
        if self._session is not None:
            self._session.close()

    def _do(self, act: Operation) -> None:
        if not self._acts:
            return
        self._next += 1
        at, session = self._timeline.now, self._session
        self._timeline.note("person", f"{act.ask} {act.number or ''}".rstrip())
        if act.ask == "kill coordinator":
            if self._network.hub is not None:
                self._network.hub.process.kill()
            self._go_on()
            return
        if session is None or session.link is None:
            self._finish(Asked(act, at, False, at, None))
            return
        waits = [True]

        def answered(data: bytes | None) -> None:
            # Either the answer or the time-out counts, whichever comes first.
            if not waits:
                return
            waits.clear()
            answer = None if data is None else as_map(unpack(data), "an answer")
            self._finish(Asked(act, at, True, self._timeline.now, answer))

        self._network.ask(session, self._key, pack(question_of(act)), answered)
        self._timeline.after(ANSWER_WITHIN, lambda: answered(None))

    def _finish(self, asked: Asked) -> None:
        answer = "no answer" if asked.answer is None else asked.answer.get("error", "done")
        self._timeline.note("person", f"{asked.act.ask}: {answer}")
        self._heard(asked)
        # A confirmed `resume` is enough; the others are there for lost ones.
        if asked.confirmed and self._next > self._unpausing:
            return
        self._go_on()


def question_of(act: Operation) -> Mapping[str, Any]:
    """The query of an act."""
    word, _, what = act.ask.partition(" ")
    if word == "pub":
        return {"ask": "pub", "type": what, "data": {"n": str(act.number)}}
    if word == "step":
        return {"ask": "step", "frames": act.number}
    return {"ask": word, "member": what} if what else {"ask": word}
