"""A world in processes of its own, started from Python.

The launcher forks its children, which a notebook or a program with threads must not do. So it is a
new Python process, and the world reaches it as a world file.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

from minerva_bus.errors import MinervaError, WorldStopped

if TYPE_CHECKING:
    from minerva_bus.api.requests import Request

POLL_SECONDS: Final = 0.02
END_SECONDS: Final = 15.0
"""Time-out for the regular end of a world."""


class Launched:
    """A launcher in its own process; leaving the context ends it with its world.

    Args:
        request: the world with the settings of the run.
        folder: for files that are passed between the processes.
        into: the file for collected data; "": none.
        paused: begin no frame until an operator resumes or steps the world.
        quiet: show errors only.

    Raises MisuseError if code of the world is not in a module.

    """

    def __init__(
        self, request: Request, folder: Path, *, into: str, paused: bool = False, quiet: bool = True
    ) -> None:
        world, self._end = request.world, folder / "end.json"
        # A world made in Python reaches the new process as a world file.
        path = world.path
        if path is None:
            path = folder / f"{world.name}.toml"
            path.write_text(world.toml(), encoding="utf-8")
        overrides = request.overrides
        config = {
            "world": str(path),
            # An empty entry means the current folder, which is given by its name instead.
            "folders": [entry for entry in sys.path if entry] + [str(Path.cwd())],
            "given": dict(world.given.options),
            "options": dict(overrides.options),
            "settings": list(overrides.settings),
            "views": list(overrides.views),
            "values": dict(overrides.values),
            "collect": {name: str(entry) for name, entry in request.file.collect.entries.items()},
            "into": into,
            "past": None if request.past is None else asdict(request.past),
            "paused": paused,
            "quiet": quiet,
            "end": str(self._end),
        }
        self._config = folder / "run.json"
        self._config.write_text(json.dumps(config), encoding="utf-8")
        self._process: subprocess.Popen[bytes] | None = None
        self._result: dict[str, Any] | None = None
        self._errors = folder / "errors.txt"
        self._quiet = quiet

    def __enter__(self) -> Self:
        # Its own session: Ctrl-C in a terminal reaches only this process, which ends the other. Its
        # standard input closes when this process dies, in any way.
        with self._errors.open("wb") as errors:
            self._process = subprocess.Popen(  # noqa: S603
                [sys.executable, "-m", "minerva_bus.api.child", str(self._config)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=errors if self._quiet else None,
                start_new_session=True,
            )
        return self

    @property
    def pid(self) -> int:
        """Its process id."""
        assert self._process is not None
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return self._process is None or self._process.poll() is not None

    def check_running(self) -> None:
        """Raise WorldStopped if it has ended."""
        if self.ended:
            raise WorldStopped(self._why())

    def result(self) -> dict[str, Any]:
        """The result, after the end of the world. Raises MinervaError if it could not run."""
        # Not in one wait: another thread may take the signal of Ctrl-C, which would not end it.
        while not self.ended:
            time.sleep(POLL_SECONDS)
        if self._result is None:
            self._result = self._read_result()
        if "error" in self._result:
            raise MinervaError(str(self._result["error"]))
        return self._result

    def _read_result(self) -> dict[str, Any]:
        # A launcher that was killed leaves no result.
        if not self._end.exists():
            return {"error": self._why()}
        return json.loads(self._end.read_text(encoding="utf-8"))

    def _why(self) -> str:
        errors = self._errors.read_text(encoding="utf-8", errors="replace").strip()
        return errors.removeprefix("minerva: ") or "the world's processes ended without a message"

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        process = self._process
        if process is None:
            return
        assert process.stdin is not None
        try:
            if process.poll() is None:
                with contextlib.suppress(ProcessLookupError):
                    process.send_signal(signal.SIGTERM)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(END_SECONDS)
        finally:
            # Also after a second Ctrl-C. The world's processes end with their launcher.
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            process.stdin.close()
            # The folder is removed next.
            self._result = self._result or self._read_result()
