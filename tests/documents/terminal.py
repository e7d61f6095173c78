"""Terminals that run the commands of a page, and its worlds."""

from __future__ import annotations

import os
import pty
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

from pages import stable

from tests.patience import eventually, patience
from tests.starts import take_terminal

PLAIN = re.compile(r"""(minerva|python [\w./-]+\.py)( |[\w./:,=@%+#-]|'[^'\n]*'|"[^"$`\\\n]*")*""")
"""Commands that need no shell: tests/starts.py starts them without the time of their imports."""
NAMES = "127.0.0.1 localhost lab.example server server.local router.example coordinator\n"


class Island:
    """A separate network namespace with free ports, where the pages' host names are local."""

    def __init__(self, folder: Path) -> None:
        self.inside: list[str] = []
        self._holder: subprocess.Popen[str] | None = None
        if shutil.which("unshare") is None or shutil.which("nsenter") is None:
            return
        hosts = folder / "hosts"
        hosts.write_text(NAMES)
        # Root needs no user namespace, in which a broker could not drop its privileges.
        user = ["--map-root-user"] if os.geteuid() else []
        script = f"ip link set lo up && mount --bind {hosts} /etc/hosts && echo ready && exec cat"
        self._holder = subprocess.Popen(
            ["unshare", *user, "--net", "--mount", "sh", "-c", script],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert self._holder.stdout is not None
        if self._holder.stdout.readline() == "ready\n":
            pid = str(self._holder.pid)
            self.inside = [
                "nsenter", "--target", pid, *(["--user", "--preserve-credentials"] if user else []),
                "--net", "--mount",
            ]  # fmt: skip

    def close(self) -> None:
        """End the namespace; it also ends with this process."""
        if self._holder is not None:
            self._holder.communicate()


class Running:
    """A command in the foreground of its own terminal."""

    def __init__(
        self, line: str, words: list[str], environment: dict[str, str], folder: Path
    ) -> None:
        self.line = line
        self.output = ""
        self._screen, side = pty.openpty()
        self._process = subprocess.Popen(
            words, stdin=side, stdout=side, stderr=side, env=environment, cwd=folder,
            start_new_session=True, preexec_fn=take_terminal,
        )  # fmt: skip
        os.close(side)
        self._over = False
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def code(self) -> int | None:
        """Its exit code, or None while it runs."""
        return self._process.poll()

    def _read(self) -> None:
        """Read its output continuously, so that it never blocks."""
        while True:
            try:
                text = os.read(self._screen, 65536).decode(errors="replace")
            except OSError:
                text = ""
            with self._changed:
                self.output += text
                self._over = not text
                self._changed.notify_all()
                if self._over:
                    return

    def shows(self, text: str) -> None:
        """Wait until its output matches a regular expression."""
        with self._changed:
            self._changed.wait_for(lambda: self._over or self._has(text), patience(150))
        assert self._has(text), f"{self.line!r} never shows {text!r}:\n{self.output}"

    def _has(self, text: str) -> bool:
        plain = stable(self.output) + "\n"
        return bool(re.search(text, self.output) or re.search(text, plain, re.M))

    def interrupt(self, key: bytes = b"\x03") -> int:
        """Press Ctrl-C or another key and wait for its end; returns its exit code."""
        if self.code is None:
            os.write(self._screen, key)
        return self.ends()

    def ends(self) -> int:
        """Wait until it has ended; returns its exit code."""
        with self._changed:
            over = self._changed.wait_for(lambda: self._over, patience(150))
        assert over, f"{self.line!r} does not end:\n{self.output}"
        return self._process.wait()

    def kill(self) -> None:
        """Kill it and all its child processes."""
        if self.code is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        self._reader.join()
        os.close(self._screen)


class Terminal:
    """A reader's folder, and the commands that run in it."""

    def __init__(self, folder: Path, island: Island) -> None:
        self.folder = self.place = folder
        self._inside = island.inside
        self._started: list[Running] = []
        programs = folder / ".programs"
        programs.mkdir()
        for name, words in (("minerva", "-m minerva_bus.cli.main"), ("python", "")):
            program = programs / name
            program.write_text(f'#!/bin/sh\nexec {sys.executable} {words} "$@"\n')
            program.chmod(0o755)
        (programs / "pytest").write_text(
            f'#!/bin/sh\nexec {sys.executable} -m pytest -p no:cacheprovider "$@"\n'
        )
        (programs / "pytest").chmod(0o755)
        # With other ones, tests/starts.py would start servers of its own for these commands.
        locale = {key: os.environ[key] for key in os.environ if key.startswith(("LANG", "LC_"))}
        self.environment = {
            **locale,
            "PATH": f"{programs}:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
            "HOME": str(folder),
            "TERM": "xterm-256color",
            "MINERVA_RUNTIME_DIR": str(folder / ".run"),
            "SDL_VIDEODRIVER": "dummy",
            "SDL_AUDIODRIVER": "dummy",
            "BROWSER": "true",
        }

    def start(self, line: str) -> Running:
        """Start a command and leave it running."""
        if PLAIN.fullmatch(line):
            program, *arguments = shlex.split(line)
            module = ("-m", "minerva_bus.cli.main") if program == "minerva" else ()
            words = [sys.executable, *module, *arguments]
        else:
            compound = re.search(r"[;|&\n<>]|^for ", line)
            words = ["bash", "-c", f"{'' if compound else 'exec '}{line}"]
        place = ["env", "--chdir", str(self.place)]  # `nsenter` leaves the folder.
        running = Running(line, [*self._inside, *place, *words], self.environment, self.place)
        self._started.append(running)
        return running

    def type(self, line: str) -> tuple[int, str]:
        """Run a command to its end; returns its exit code and its output."""
        lines = line.split("; ")
        if lines[1:] and all(map(PLAIN.fullmatch, lines)):
            done = [self.type(each) for each in lines]
            return done[-1][0], "".join(output for _, output in done)
        running = self.start(line)
        return running.ends(), running.output

    def until(self, line: str, text: str) -> None:
        """Repeat a command until it succeeds and its output matches a regular expression."""
        said = []

        def prints():
            code, output = self.type(line)
            said.append(output)
            return not code and re.search(text, output)

        eventually(prints, lambda: f"{line!r} prints {text!r}\n{said[-1]}", 150)

    def close(self) -> None:
        """Kill all commands that still run."""
        for running in self._started:
            running.kill()
