"""`minerva run WORLD` with a page, and browsers at it, for tests of the page."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
from pathlib import Path

from minerva_bus.errors import BusError
from minerva_bus.runtime.operator_client import Client
from tests.patience import eventually

ROOT = Path(__file__).parents[2]
PHONE = ROOT / "members" / "javascript" / "examples" / "phone"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def copied(folder):
    """A copy of the example, so that a test may change it."""
    return Path(shutil.copytree(PHONE, folder / "world"))


class PageRun:
    """A running world with a page: its `url`, its output on stderr, and the events of its frames."""

    def __init__(self, folder, *arguments, scheme="http"):
        kept = {key: value for key, value in os.environ.items() if not key.startswith("MINERVA_")}
        runtime = folder / "runtime"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "minerva_bus.cli.main", "run", *map(str, arguments), "--json"],
            env={**kept, "MINERVA_RUNTIME_DIR": str(runtime)}, cwd=folder, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        self.lines: list[str] = []
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()
        line = self.line(f"{scheme}://127.0.0.1:")
        self.url = line[line.index(scheme) :].strip()
        self.base = self.url.partition("/?")[0]
        (registered,) = runtime.glob("*.json")
        registration = json.loads(registered.read_text())
        self.client = Client(registration["endpoint"], registered.stem)
        self.events: list[str] = []
        threading.Thread(target=self._record, daemon=True).start()

    def _read(self):
        for line in self.process.stderr:
            self.lines.append(line)

    def _record(self):
        with suppress(BusError):
            for record in self.client.records():
                self.events += map(str, record.events)

    def line(self, part):
        """Wait for a line of output that contains a text."""

        def found():
            return next((line for line in list(self.lines) if part in line), "")

        return eventually(found, lambda: f"no {part!r} in {self.lines}")

    def event(self, part):
        """Wait for an event whose text contains a part."""

        def found():
            return next((event for event in list(self.events) if part in event), "")

        return eventually(found, lambda: f"no {part!r} among {sorted(set(self.events))[:20]}")

    def member(self, name):
        """The status of a member; None if the world does not know it."""
        members = self.client.operator.status().members
        return next((member for member in members if member.name == name), None)

    def present(self, name):
        """Wait until a member is present."""
        eventually(
            lambda: (member := self.member(name)) is not None and member.state == "present",
            lambda: f"{name} is not present: {self.lines}",
        )

    def summary(self):
        """The summary of the run, after its end."""
        output, _ = self.process.stdout.read(), self.process.wait()
        assert self.process.returncode == 0, self.lines
        return json.loads(output)

    def end(self):
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


@contextmanager
def running(folder, *arguments, **options):
    run = PageRun(folder, *arguments, **options)
    try:
        # The threads of an open client keep the process of the tests alive.
        with run.client:
            yield run
    finally:
        run.end()


def shown(page, frame=0):
    """Wait until a page has drawn a view of this frame or a later one."""
    eventually(
        lambda: int(page.get_attribute("body", "data-frame") or -1) >= frame,
        lambda: f"no frame {frame}: {page.inner_text('body')}",
    )
