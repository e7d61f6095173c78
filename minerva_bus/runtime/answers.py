"""Answers questions of operators: over the bus with their rights, and from other threads."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Final

import zenoh

from minerva_bus.errors import MinervaError
from minerva_bus.runtime.admission import Admission
from minerva_bus.runtime.control import answer
from minerva_bus.runtime.inbox import Question, question
from minerva_bus.runtime.operated import ASKER, Command, Operated
from minerva_bus.runtime.system import System
from minerva_bus.runtime.watchers import LocalQuestion
from minerva_bus.wire.keys import who_asks
from minerva_bus.wire.message_limits import Limits, check, values_in
from minerva_bus.wire.plain import as_map, pack, unpack

MAX_VALUES: Final = 25_000
"""Values of a question: the main thread reads an order at once, and prints it for people."""

PAUSE_FACTOR: Final = 2.0
"""Pause after an answer, as a multiple of the time that the answer took."""


class Answers:
    """Checks and queues the questions to one world and answers them with `commands`.

    At most `limits.questions` wait at the same time, and as many of those who may not operate the
    world, which come last. Answering takes at most a third of the coordinator's time, so that
    questions cannot stop the frames. `operated` is called before an answer is sent.
    """

    def __init__(
        self,
        world: Operated,
        admission: Admission,
        limits: Limits,
        operated: Callable[[], None],
        system: System,
        commands: Mapping[str, Command],
    ) -> None:
        self._operators = deque[Question]()
        self._readers = deque[Question]()
        self._world = world
        self._admission = admission
        self._limits = limits
        self._operated = operated
        self._clock = system.monotonic
        self._commands = commands
        # Count the questions of readers and of operators between `admit` and their answers. Deques,
        # because several threads of Zenoh may append at the same time.
        self._admitted = deque[None](), deque[None]()
        self._next_at = 0.0

    def admit(self, query: zenoh.Query) -> Question | None:
        """The question of a query, or None if too many wait; called in a thread of Zenoh."""
        # Checked in Zenoh's thread, so that a flood of questions does
        # not fill the coordinator's inbox, nor its memory.
        most, most_bytes = self._limits.questions, self._limits.small_bytes
        asked, size = question(query, most_bytes), len(query.payload) if query.payload else 0
        _, orders, key = self._asker(asked)
        admitted = self._admitted[orders]
        if size > most_bytes:
            problem = f"a question has {size} bytes, over {most_bytes}"
        elif len(admitted) >= most:
            problem = f"{most} questions wait for an answer already; ask again in a moment"
        else:
            admitted.append(None)
            return asked
        asked.reply(key, pack({"error": problem}))
        return None

    def add(self, asked: Question) -> None:
        """Queue an admitted question."""
        _, orders, _ = self._asker(asked)
        (self._operators if orders else self._readers).append(asked)

    def __bool__(self) -> bool:
        """Whether a question waits for its answer."""
        return bool(self._operators or self._readers)

    @property
    def wait(self) -> float:
        """Seconds until the next question may be answered; 0: now."""
        # Callers sleep for this time, and the clock may pass the end between two of their calls.
        return max(0.0, self._next_at - self._clock())

    def answer_due(self) -> None:
        """Answer the next question once the pause after the previous answer is over."""
        if not self or self.wait > 0:
            return
        began = self._clock()
        orders = bool(self._operators)
        try:
            self._answer((self._operators if orders else self._readers).popleft())
        finally:
            self._admitted[orders].pop()
            now = self._clock()
            # In proportion to the answer, so that expensive questions are answered less often.
            self._next_at = now + PAUSE_FACTOR * (now - began)

    def answer_local(self, asked: LocalQuestion) -> None:
        """Answer a question from another thread of this process at once."""
        asked.answer.set_result(answer(asked.question, self._world, self._commands))

    def _answer(self, question: Question) -> None:
        asker, orders, key = self._asker(question)
        try:
            most = min(self._limits.values, MAX_VALUES)
            check("a question", values_in(question.data, most), most, "values")
            asked = as_map(unpack(question.data), "a question")
            objection = self._admission.objection_to_question(asker, orders, asked.get("ask"))
            reply = (
                {"error": objection}
                if objection
                else answer({**asked, ASKER: asker}, self._world, self._commands)
            )
        except MinervaError as error:
            reply = {"error": str(error)}
        self._operated()  # The journal must contain the change before the operator is notified.
        question.reply(key, pack(reply))

    def _asker(self, question: Question) -> tuple[str, bool, str]:
        return who_asks(question.key, self._world.algorithm.world.name)
