"""Questions of people: so many may wait, and to answer them takes a share of the time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

from minerva_bus.runtime.inbox import Question
from minerva_bus.runtime.system import System
from minerva_bus.wire.keys import who_asks
from minerva_bus.wire.plain import pack

PAUSE: Final = 2.0
"""For so many times as long as an answer took, others have the coordinator's time."""


class Questions:
    """Those that wait for an answer, `most` at once; `answer` gives one."""

    def __init__(
        self, most: int, answer: Callable[[Question], None], world: str, system: System
    ) -> None:
        self._most = most
        self._answer = answer
        self._world = world
        self._system = system
        self._waiting: deque[Question] = deque()
        self._open: deque[None] = deque()  # Counts, as threads of Zenoh's may do at once.
        self._next_at = 0.0

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def hear(self, question: Question) -> Question | None:
        """Let a question in, or answer that there are too many; called in Zenoh's thread."""
        if len(self._open) < self._most:
            self._open.append(None)
            return question
        key = who_asks(question.key, self._world)[2]
        problem = f"{self._most} questions wait for an answer already; ask again in a moment"
        question.reply(key, pack({"error": problem}))
        return None

    def add(self, question: Question) -> None:
        """Have a question answered when it is its turn."""
        self._waiting.append(question)

    @property
    def wait(self) -> float:
        """Seconds until one may be answered."""
        return self._next_at - self._system.monotonic()

    def answer_due(self) -> None:
        """Answer the next one, if others have had their time."""
        if self._waiting and self.wait <= 0:
            began = self._system.monotonic()
            try:
                self._answer(self._waiting.popleft())
            finally:
                self._open.pop()
                now = self._system.monotonic()
                self._next_at = now + PAUSE * (now - began)
