"""Processes of the member under test."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Final, Protocol, TypeAlias

from minerva_bus.errors import MisuseError

OUTPUT_CHARS: Final = 2_000
"""Characters of a member's output that a failed case shows."""


class RunningMember(Protocol):
    """A member that has been started."""

    def code(self, within: float) -> int | None:
        """Its exit code; None if it still runs after `within` seconds."""
        ...

    def interrupt(self) -> None:
        """Ask it to end, as a launcher does."""
        ...

    def kill(self) -> None:
        """End it at once."""
        ...

    def output(self) -> str:
        """The end of what it has printed."""
        ...


StartMember: TypeAlias = Callable[[Mapping[str, str]], RunningMember]
"""Starts a member with environment variables."""


def command(words: Sequence[str]) -> StartMember:
    """Starts a program for each case. Raises MisuseError if there is no such program."""

    def start(environment: Mapping[str, str]) -> RunningMember:
        return _CommandProcess(words, environment)

    return start


class _CommandProcess:
    """A program in a process group of its own, so that its children end with it."""

    def __init__(self, words: Sequence[str], environment: Mapping[str, str]) -> None:
        self._printed = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `kill`
        try:
            self._process = subprocess.Popen(  # noqa: S603 - the user's own command
                list(words),
                env={**os.environ, **environment},
                stdin=subprocess.DEVNULL,
                stdout=self._printed,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except OSError as error:
            self._printed.close()
            raise MisuseError(f"{words[0]!r} cannot be started: {error.strerror}") from None

    def code(self, within: float) -> int | None:
        try:
            return self._process.wait(within)
        except subprocess.TimeoutExpired:
            return None

    def interrupt(self) -> None:
        self._process.terminate()

    def kill(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def output(self) -> str:
        self._printed.seek(0)
        return self._printed.read().decode("utf-8", "replace")[-OUTPUT_CHARS:]
