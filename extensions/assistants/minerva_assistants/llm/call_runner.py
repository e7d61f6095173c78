"""Calls of a backend, in a thread with an event loop."""

from __future__ import annotations

import asyncio
import threading
from queue import SimpleQueue
from typing import Final

from minerva_assistants.llm.answering import (
    Answering,
    CallGate,
    CallLimits,
    CallSetup,
    RequestResult,
)
from minerva_assistants.llm.reading import MindRequest, RequestKey

CLOSE_SECONDS: Final = 1.0


class CallRunner:
    """Answers requests concurrently; `results` has them in the order in which they end.

    A request that is cancelled has a result, too, because its calls may have cost something.
    """

    def __init__(self, setup: CallSetup, limits: CallLimits) -> None:
        self.results: SimpleQueue[RequestResult] = SimpleQueue()
        self._setup, self._limits = setup, limits
        self._tasks: dict[RequestKey, asyncio.Task[RequestResult]] = {}
        self._gate = CallGate(limits)
        self._loop = asyncio.new_event_loop()
        # A daemon: it must not delay the end of the process, whatever a backend does.
        threading.Thread(target=self._loop.run_forever, daemon=True).start()

    def ask(self, asked: MindRequest) -> None:
        """Begin to answer a request."""
        self._loop.call_soon_threadsafe(self._start, asked)

    def cancel(self, key: RequestKey) -> None:
        """Stop answering a request."""
        self._loop.call_soon_threadsafe(self._stop, key)

    def close(self) -> None:
        """Cancel all calls and end the thread."""
        closed = asyncio.run_coroutine_threadsafe(self._close(), self._loop)
        try:
            closed.result(CLOSE_SECONDS)
        except TimeoutError:
            self._setup.log(f"llm: calls have not ended within {CLOSE_SECONDS:g} s")
        except Exception as error:
            problem = f"{type(error).__name__}: {error}"
            self._setup.log(f"llm: {self._setup.backend.name}: {problem}")
        self._loop.call_soon_threadsafe(self._loop.stop)

    # --- in the thread of the loop ---

    def _start(self, asked: MindRequest) -> None:
        answering = Answering(self._setup, self._limits, self._gate, asked)
        task = self._tasks[asked.key] = self._loop.create_task(answering.result())
        task.add_done_callback(lambda done: self._finish(answering, done))

    def _stop(self, key: RequestKey) -> None:
        task = self._tasks.get(key)
        if task is not None:
            task.cancel()

    def _finish(self, answering: Answering, task: asyncio.Task[RequestResult]) -> None:
        del self._tasks[answering.asked.key]
        # Only a task that was cancelled before it began is cancelled here.
        result = answering.ended("cancelled", "") if task.cancelled() else task.result()
        self.results.put(result)

    async def _close(self) -> None:
        for task in self._tasks.values():
            task.cancel()
        await asyncio.gather(*self._tasks.values(), return_exceptions=True)
        await self._setup.backend.close()
