"""The world of checks/chaos.py in its processes, and the faults that are injected into it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from random import Random

from checks.chaos_repeater import Repeater
from checks.chaos_world import HOSTS, NAME, world_text
from minerva_bus.errors import MinervaError
from minerva_bus.runtime.operator_client import Client
from minerva_conformance.proxy import Proxy

MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]
HERE = Path(__file__).resolve().parent.parent
MAX_GUESTS = 3
FAULTS = {"kill": 5, "freeze": 4, "pause": 1, "join": 3, "leave": 2, "drop": 2, "drain": 1}
"""Methods of `Chaos`, with their weights."""
LAST_LINES = 60
"""Number of lines printed from the end of each log after a time-out."""
LONG_WAIT = 3.0
"""Seconds after which a world must say for whom it waits, and what follows."""


class Chaos:
    """A running world, and the faults that are injected into it."""

    def __init__(self, folder: Path, seed: int, rate: float) -> None:
        self.folder = folder
        self.random = Random(seed)
        self.done: Counter[str] = Counter()
        self.unsaid: list[str] = []
        self.world = folder / f"{NAME}.toml"
        self.world.write_text(world_text(seed))
        self.guests: dict[str, subprocess.Popen[bytes]] = {}
        self._joined = 0
        self._log = (folder / "chaos.log").open("w")
        self._output = (folder / "run.log").open("w")
        self.environment = {**os.environ, "MINERVA_RUNTIME_DIR": str(folder / "runtime")}

        record = ["--record", folder / "chaos.mcap", "--flush", 0.5]
        self._words = ["run", self.world, "--rate", rate, *record, "--json"]

    def start(self) -> None:
        self.launcher = subprocess.Popen(
            [*MINERVA, *map(str, self._words)],
            cwd=HERE, env=self.environment, stdout=subprocess.PIPE, stderr=self._output,
        )  # fmt: skip
        place = self.folder / "runtime" / f"{NAME}.json"
        _until(lambda: place.exists() and place.read_text().endswith("}"), "the world has started")
        self.endpoint: str = json.loads(place.read_text())["endpoint"]
        port = int(self.endpoint.rpartition(":")[2])
        self.proxy = Proxy(port, lambda: 0.02 * Random().random())
        _until(lambda: self.frame() > 3, "frames advance")
        self.repeater = Repeater(self.endpoint, Random(self.random.random()))

    def command(self, *words: object) -> subprocess.CompletedProcess[str]:
        """Run a command of `minerva` to its end."""
        return subprocess.run(
            [*MINERVA, *map(str, words)], cwd=HERE, env=self.environment, capture_output=True,
            text=True,
        )  # fmt: skip

    # --- queries ---

    @contextmanager
    def client(self) -> Iterator[Client]:
        with Client(self.endpoint, NAME) as client:
            yield client

    def frame(self) -> int:
        try:
            with self.client() as client:
                return client.operator.status().frame
        except MinervaError:
            return -1

    def pids(self) -> dict[str, int]:
        """Process ids by name; empty if the coordinator does not answer."""
        try:
            with self.client() as client:
                members = client.operator.status().members
        except MinervaError:
            return {}
        pids = {
            member.name: member.pid for member in members if member.pid and member.state != "left"
        }
        others = set(_children(self.launcher.pid)) - set(pids.values())
        if len(others) == 1:
            pids["coordinator"] = others.pop()
        return {name: pid for name, pid in pids.items() if name not in self.guests}

    # --- faults ---

    def disturb(self) -> None:
        """Inject a random fault, and wait for up to 1.2 s."""
        fault = self.random.choices([*FAULTS], [*FAULTS.values()])[0]
        pick = self.random.random()
        with suppress(MinervaError, ProcessLookupError):
            what = getattr(self, fault)(pick)
            if what:
                self.done[fault] += 1
                print(f"{time.monotonic():.2f} {fault} {what}", file=self._log, flush=True)
            self._check_waiting()
        time.sleep(self.random.uniform(0.1, 1.2))

    def _check_waiting(self) -> None:
        """Note if a world that has waited for a while does not say for whom, or what follows."""
        with self.client() as client:
            status = client.operator.status()
        outlooks = {member.name: member.outlook for member in status.members}
        said = bool(status.waiting) and all(outlooks.get(name) for name in status.waiting)
        if status.waited > LONG_WAIT and not said:
            self.unsaid.append(f"frame {status.frame}, {status.waited:.1f} s: {status.waiting}")

    def kill(self, pick: float) -> str:
        name, pid = _pick(self.pids(), pick)
        if pid:
            os.kill(pid, signal.SIGKILL)
        return name

    def freeze(self, pick: float) -> str:
        name, pid = _pick(self.pids(), pick)
        if not pid:
            return ""
        seconds = self.random.choice((0.05, 0.3, 1.0, 4.0))
        os.kill(pid, signal.SIGSTOP)
        time.sleep(seconds)
        os.kill(pid, signal.SIGCONT)
        return f"{name} for {seconds} s"

    def join(self, pick: float) -> str:
        if len(self.guests) >= MAX_GUESTS:
            return ""
        self._joined += 1
        name = f"guest-{self._joined}"
        slow = pick < 0.5
        endpoint = f"tcp/127.0.0.1:{self.proxy.port}" if slow else self.endpoint
        words = ["attach", "checks.colony:Ant", "--name", name, "--world", NAME]
        self.guests[name] = subprocess.Popen(
            [*MINERVA, *words, "--connect", endpoint], cwd=HERE, env=self.environment,
            stdout=self._output, stderr=self._output,
        )  # fmt: skip
        return f"{name}{' by a slow link' if slow else ''}"

    def leave(self, pick: float) -> str:
        return self._end_guest(pick, signal.SIGINT)

    def drop(self, pick: float) -> str:
        return self._end_guest(pick, signal.SIGKILL)

    def _end_guest(self, pick: float, how: signal.Signals) -> str:
        if not self.guests:
            return ""
        name = sorted(self.guests)[int(pick * len(self.guests))]
        guest = self.guests.pop(name)
        guest.send_signal(how)
        with suppress(subprocess.TimeoutExpired):
            guest.wait(5)
        guest.kill()
        guest.wait()
        return name

    def drain(self, pick: float) -> str:
        name = f"ants-{1 + int(HOSTS * pick)}"
        with self.client() as client:
            client.ask("drain", member=name)
        return name

    def pause(self, _: float) -> str:
        with self.client() as client:
            client.operator.pause()
        time.sleep(0.3)
        _until(self._resumed, "the world resumes")
        return "for 0.3 s"

    def _resumed(self) -> bool:
        with suppress(MinervaError), self.client() as client:
            client.operator.resume()
            return True
        return False

    # --- the end ---

    def end(self) -> dict[str, object]:
        """Wait until frames advance without faults, and stop the world; returns its summary."""
        self.repeater.close()
        frame = self.frame()
        _until(lambda: self.frame() > frame + 3, "frames advance without faults", 60.0)
        while self.guests:
            self._end_guest(0.0, signal.SIGINT)
        with suppress(MinervaError), self.client() as client:
            client.ask("stop")
        out, _ = self.launcher.communicate(timeout=30)
        return json.loads(out)

    def print_last_lines(self) -> None:
        """Print the last faults and the last log lines of the world."""
        for name in ("chaos.log", "run.log"):
            lines = (self.folder / name).read_text(errors="replace").splitlines()
            print(f"--- {name} ---", *lines[-LAST_LINES:], sep="\n")
        with suppress(MinervaError), self.client() as client:
            print("--- status ---", client.operator.status(), sep="\n")

    def close(self) -> None:
        """Kill all remaining processes."""
        for guest in self.guests.values():
            guest.kill()
        pids = _children(self.launcher.pid)
        if self.launcher.poll() is None:
            self.launcher.kill()
        for pid in pids:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.proxy.close()


def _pick(pids: dict[str, int], pick: float) -> tuple[str, int]:
    names = sorted(pids)
    name = names[int(pick * len(names))] if names else ""
    return name, pids.get(name, 0)


def _children(pid: int) -> list[int]:
    with suppress(OSError):
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
        return [int(pid) for pid in text.split()]
    return []


def _until(what: Callable[[], bool], why: str, patience: float = 40.0) -> None:
    end = time.monotonic() + patience
    while not what():
        if time.monotonic() > end:
            raise SystemExit(f"chaos: {why}: not within {patience:.0f} s")
        time.sleep(0.05)
