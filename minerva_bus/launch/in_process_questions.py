"""Questions of operators to a world in this process, from any thread."""

from __future__ import annotations

import threading
from collections.abc import Generator, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NoAnswer
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any, Final

from minerva_bus.errors import BusError
from minerva_bus.runtime.control import answer
from minerva_bus.runtime.operated import Operated

ANSWER_SECONDS: Final = 1.0


class InProcessQuestions:
    """Questions of operators, from any thread.

    While the world runs, the thread that runs it answers them between two frames.
    """

    world: Operated

    def __init__(self, name: str) -> None:
        self._name = name
        self._running = threading.RLock()
        self._queue: SimpleQueue[tuple[dict[str, Any], Future[dict[str, Any]]]] = SimpleQueue()

    @contextmanager
    def deferred(self) -> Generator[None]:
        """Defer questions of other threads to `answer`."""
        with self._running:
            yield

    def ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        """The answer to a question. Raises BusError if there is none within ANSWER_SECONDS."""
        asked = {"ask": question, **details}
        # The thread that runs the world must not wait for itself, as after a key in a window.
        if self._running.acquire(blocking=False):
            try:
                reply = answer(asked, self.world)
            finally:
                self._running.release()
        else:
            later: Future[dict[str, Any]] = Future()
            self._queue.put((asked, later))
            try:
                reply = later.result(ANSWER_SECONDS)
            except NoAnswer:
                raise BusError(f"{self._name} has not answered for a second") from None
        if "error" in reply:
            raise BusError(str(reply["error"]))
        return reply

    def answer(self) -> None:
        """Answer all waiting questions."""
        while True:
            try:
                asked, later = self._queue.get_nowait()
            except Empty:
                return
            later.set_result(answer(asked, self.world))
