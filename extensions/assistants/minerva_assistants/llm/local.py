"""Backends on this machine: a Python function, or a program."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import json
import os
import signal
import threading
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

from minerva_assistants.llm.backends import BackendError, Completion, Prompt, Unavailable
from minerva_assistants.llm.streams import MAX_BYTES, limited

MAX_DETAIL: Final = 200
CLOSED_WITHIN: Final = 1.0
"""Seconds in which a killed program has ended."""


class FunctionBackend:
    """Calls a function, plain or `async`, with a `Prompt`; it returns a text or a mapping."""

    scripted = False

    def __init__(self, spec: str, function: Callable[[Prompt], Any]) -> None:
        self.name = spec
        self._function = function

    async def complete(self, prompt: Prompt) -> Completion:
        """Raises BackendError for an exception of the function."""
        try:
            if inspect.iscoroutinefunction(self._function):
                value = await self._function(prompt)
            else:
                value = await _in_thread(lambda: self._function(prompt))
        except Exception as error:
            raise BackendError(f"{self.name}: {type(error).__name__}: {error}") from None
        return Completion(text_of(value), model=self.name)

    async def close(self) -> None:
        """Nothing to release."""


class CommandBackend:
    """Runs a program for each request: a JSON object on its input, the answer on its output."""

    scripted = False

    def __init__(self, command: Sequence[str]) -> None:
        self.name = " ".join(command)
        self._command = tuple(command)

    async def complete(self, prompt: Prompt) -> Completion:
        """Raises BackendError."""
        asked = {**asdict(prompt.request), "messages": prompt.messages, "schema": prompt.schema}
        pipe = asyncio.subprocess.PIPE
        try:
            process = await asyncio.create_subprocess_exec(
                *self._command,
                stdin=pipe,
                stdout=pipe,
                stderr=pipe,
                start_new_session=True,
                # With less, a pipe that nobody reads any more is paused, and would stay open.
                limit=MAX_BYTES,
            )
        except OSError as error:
            raise BackendError(f"{self._command[0]}: {error.strerror}") from None
        try:
            assert process.stdin
            assert process.stdout
            assert process.stderr
            _, output, errors = await asyncio.gather(
                _write(process.stdin, json.dumps(asked).encode()),
                limited(_chunks(process.stdout)),
                limited(_chunks(process.stderr)),
            )
            await process.wait()
        finally:
            if process.returncode is None:  # cancelled, or over its time
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                # Until the pipes are closed; a program that it has detached may keep them.
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(process.wait(), CLOSED_WITHIN)
        if process.returncode:
            reason = " ".join(errors.decode(errors="replace").split())[-MAX_DETAIL:]
            raise Unavailable(f"{self._command[0]} exited with {process.returncode}: {reason}")
        return Completion(output.decode(errors="replace"), model=self.name)

    async def close(self) -> None:
        """Nothing to release."""


def text_of(value: Any) -> str:
    """The text of an answer: a mapping as a JSON object. Raises BackendError."""
    if isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        try:
            return json.dumps(value)
        except (TypeError, ValueError) as error:
            raise BackendError(f"the answer is not a JSON object: {error}") from None
    raise BackendError(f"the answer is {value!r:.60}; expected a text or a mapping")


async def _write(pipe: asyncio.StreamWriter, data: bytes) -> None:
    with contextlib.suppress(ConnectionError):  # The program need not read its input.
        pipe.write(data)
        await pipe.drain()
    pipe.close()


async def _chunks(pipe: asyncio.StreamReader) -> AsyncIterator[bytes]:
    while chunk := await pipe.read(1 << 16):
        yield chunk


async def _in_thread(function: Callable[[], Any]) -> Any:
    """The result of a function that may block.

    A daemon thread of its own: a pool would wait at the end for a function that never returns.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[Any] = loop.create_future()

    def finish(value: Any, error: Exception | None) -> None:
        if done.cancelled():
            return
        if error is None:
            done.set_result(value)
        else:
            done.set_exception(error)

    def run() -> None:
        value, failure = None, None
        try:
            value = function()
        except Exception as error:
            failure = error
        # The loop may be closed by now, and nobody needs the result.
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(finish, value, failure)

    threading.Thread(target=run, daemon=True).start()
    return await done
