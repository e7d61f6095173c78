"""A world under random faults for some minutes gives the same string as without faults.

    python -m benchmarks.chaos [--minutes 10] [--seed 1] [--rate 20] [--regions 0] [--hosts 0]
                               [--lag 0] [--move-every 50] [--folder FOLDER]

Eight processes run 200 ants (benchmarks/models/colony.py), which are born and die. At random times,
members and the coordinator are killed (SIGKILL) or frozen for a while (SIGSTOP, SIGCONT); external
hosts join, some of them through a proxy that delays the traffic, and leave, are killed or drained;
the world is paused. Meanwhile another client repeats messages of members and the coordinator with a
delay. At the end the string must have the digest of an undisturbed run, and the two records must
have the same events in every frame. The exit code is 0 if so, otherwise 1.

With --regions, the world runs as so many regions by position. They are killed and frozen like
members; no external hosts join. With --hosts, each region has so many hosts of its agents, which
are killed and frozen, too. With --lag, regions run ahead of each other between two moves of agents,
so a generator without views takes the place of device and observer.

The seed determines the faults and their order; their exact times depend on the machine.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from random import Random

from benchmarks.chaos_repeater import Repeater
from benchmarks.chaos_world import HOSTS, NAME, Layout, world_text
from minerva_bus.errors import MinervaError
from minerva_bus.runtime.client import Client
from minerva_bus.testing.proxy import Proxy

MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]
HERE = Path(__file__).resolve().parent.parent
MAX_GUESTS = 3
FAULTS = {"kill": 5, "freeze": 4, "pause": 1}
"""Methods of `Chaos`, with their weights."""
FAULTS_OF_GUESTS = {"join": 3, "leave": 2, "drop": 2, "drain": 1}
LAST_LINES = 60
"""Number of lines printed from the end of each log after a time-out."""


class Chaos:
    """A running world, and the faults that are injected into it."""

    def __init__(self, folder: Path, seed: int, rate: float, layout: Layout) -> None:
        self.folder = folder
        self.random = Random(seed)
        self.faults = FAULTS if layout.regions else FAULTS | FAULTS_OF_GUESTS
        self.done: Counter[str] = Counter()
        self.world = folder / f"{NAME}.toml"
        self.world.write_text(world_text(seed, layout))
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
        fault = self.random.choices([*self.faults], [*self.faults.values()])[0]
        pick = self.random.random()
        with suppress(MinervaError, ProcessLookupError):
            what = getattr(self, fault)(pick)
            if what:
                self.done[fault] += 1
                print(f"{time.monotonic():.2f} {fault} {what}", file=self._log, flush=True)
        time.sleep(self.random.uniform(0.1, 1.2))

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
        words = ["attach", "benchmarks.models.colony:Ant", "--name", name, "--world", NAME]
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


def undisturbed(chaos: Chaos, frames: int) -> dict[str, object]:
    """The summary of a recorded run of `frames` frames in one process."""
    done = chaos.command(
        "run", chaos.world, "--in-process", "--regions", 0, "--frames", frames,
        "--record", chaos.folder / "undisturbed.mcap", "--json",
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"chaos: the undisturbed run failed ({done.returncode}):\n{done.stderr}")
    return json.loads(done.stdout)


def same_events(chaos: Chaos) -> str:
    """Differences between the two records, or an empty string."""
    done = chaos.command("diff", chaos.folder / "undisturbed.mcap", chaos.folder / "chaos.mcap")
    if done.returncode == 0:
        return ""
    # A killed `diff` prints nothing, and must not count as equal.
    return done.stdout + done.stderr or f"minerva diff ended with exit code {done.returncode}"


def run(folder: Path, given: argparse.Namespace) -> bool:
    minutes, seed = given.minutes, given.seed
    layout = Layout(given.regions, given.lag, given.move_every, given.hosts)
    chaos = Chaos(folder, seed, given.rate, layout)
    try:
        chaos.start()
        end = time.monotonic() + 60.0 * minutes
        while time.monotonic() < end:
            chaos.disturb()
            if chaos.launcher.poll() is not None:
                print(f"chaos: the world has ended; see {folder}/run.log")
                return False
        result = chaos.end()
        repeated = chaos.repeater.sent
    except SystemExit:
        chaos.print_last_lines()
        raise
    finally:
        chaos.close()
    frames = int(str(result["frames"]))
    alone = undisturbed(chaos, frames)
    differ = same_events(chaos)
    faults = ", ".join(f"{name} {count}" for name, count in sorted(chaos.done.items()))
    print(f"seed {seed}: {frames} frames, {faults}; {repeated} messages repeated")
    same = result["digest"] == alone["digest"]
    print(f"digest {result['digest']} {'=' if same else 'IS NOT'} {alone['digest']}")
    print(differ or "the same events in every frame")
    return same and not differ


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, default=20.0)
    parser.add_argument("--regions", type=int, default=0, help="0: one coordinator")
    parser.add_argument("--hosts", type=int, default=0, help="hosts of agents in each region")
    parser.add_argument("--lag", type=int, default=0, help="frames that regions run ahead")
    parser.add_argument("--move-every", type=int, default=50, help="frames between moves of agents")
    parser.add_argument("--folder", type=Path, help="where logs and records stay")
    given = parser.parse_args()
    if given.lag and not given.regions:
        parser.error("--lag is between regions: add --regions")
    if given.hosts and not given.regions:
        parser.error("--hosts are those of regions: add --regions")
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        raise SystemExit(not run(folder, given))


if __name__ == "__main__":
    main()
