"""Worlds in real processes on a real bus, for tests: start, observe, kill and count them."""

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from unittest.mock import patch

import zenoh

from minerva_bus.cli.main import main
from minerva_bus.errors import BusError
from minerva_bus.launch import child_processes
from minerva_bus.runtime.operator_client import Client
from tests.patience import DEFAULT, eventually, patience

MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]
YARD = Path(__file__).parent / "yard.py"
_numbers = itertools.count(1)

STRING = " · ".join(f"AWalker#{name}<x={x}>" for x, name in enumerate("abcd"))
MEMBERS = """
[process.steps]
service = "yard:Steps"

[process.walkers]
agents = "yard:Walker"
"""
ALL_KINDS = (
    MEMBERS
    + """
[process.water]
service = "yard:Water"

[process.eye]
service = "yard:Eye"

[process.screen]
service = "yard:Screen"

[process.noise]
service = "yard:Noise"
"""
)


def put(session, key, data):
    """Put data; block instead of dropping it under congestion."""
    session.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)


def write_world(folder, members=MEMBERS, string=STRING, bus="", **world):
    """Write a world file with a unique name, and the module `yard` beside it."""
    shutil.copy(YARD, folder / "yard.py")
    name = world.pop("name", f"yard-{os.getpid()}-{next(_numbers)}")
    settings = {"seed": 7, "dt": 0.1, "frames": 30, **world}
    lines = [f"{key} = {json.dumps(value)}" for key, value in settings.items()]
    path = folder / f"{name}.toml"
    path.write_text(
        f'[world]\nname = "{name}"\nstring = {json.dumps(string, ensure_ascii=False)}\n'
        f'vocabulary = "yard:vocabulary"\n' + "\n".join(lines) + f"\n{members}\n[bus]\n{bus}\n"
    )
    return path


def environment(folder):
    """A separate environment for the worlds of one folder."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("MINERVA_")}
    return {**kept, "MINERVA_RUNTIME_DIR": str(folder / "runtime"), "PYTHONUNBUFFERED": "1"}


def minerva(folder, *words):
    """Run the command until it exits."""
    return subprocess.run(
        [*MINERVA, *map(str, words)], cwd=folder, env=environment(folder), capture_output=True,
        text=True, stdin=subprocess.DEVNULL,
    )  # fmt: skip


def here(folder, *words):
    """Run the command in this process, if it starts no others: fifty times as fast."""
    out, err = StringIO(), StringIO()
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    arguments = patch.object(sys, "argv", ["minerva", *map(str, words)])
    # A child of a process that has used Zenoh cannot use it.
    reason = "this command starts processes: call `minerva` instead of `here`"
    no_fork = patch.object(child_processes, "fork", side_effect=AssertionError(reason))
    environ = patch.dict(os.environ, environment(folder), clear=True)
    with chdir(folder), environ, arguments, no_fork:
        try:
            with redirect_stdout(out), redirect_stderr(err):
                main()
            code = 0
        except SystemExit as end:
            code = end.code or 0
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def summary(done):
    """The summary that a run printed with --json."""
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def alone(path, *words):
    """The summary of an undisturbed run in this process, as fast as possible."""
    return summary(here(path.parent, "run", path, "--in-process", "--rate", 0, "--json", *words))


def ends_as_alone(world):
    """Stop a world, and compare its string with that of an undisturbed run."""
    assert here(world.folder, "stop", world.name).returncode == 0
    assert world.ends() == 0
    frames = next(int(x.split()[0].replace(",", "")) for x in world.output if "frames in" in x)
    digest = next(x.split()[1] for x in world.output if "digest" in x)
    assert alone(world.path, "--frames", frames)["digest"] == digest
    world.gone()


class Run:
    """A running command; its output is collected, and the process is always terminated.

    `inside`: a command prefix, for example `nohup`.
    """

    def __init__(self, folder, *words, inside=()):
        self.process = subprocess.Popen(
            [*inside, *MINERVA, *map(str, words)], cwd=folder, env=environment(folder),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, stdin=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        self.folder = folder
        self.lines = []
        self.output = []
        self._threads = [self._gather("stderr", self.lines), self._gather("stdout", self.output)]

    def _gather(self, name, lines):
        stream = getattr(self.process, name)

        def keep():
            for line in iter(stream.readline, ""):
                lines.append(line.rstrip("\n"))

        thread = threading.Thread(target=keep, daemon=True)
        thread.start()
        return thread

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for thread in self._threads:
            thread.join(patience(5))
        self.process.stdout.close()
        self.process.stderr.close()

    @property
    def text(self):
        return "\n".join(self.lines)

    def says(self, *words, times=1, seconds=DEFAULT):
        """Wait for that many lines with these words on standard error; returns the last of them."""

        def found():
            over = self.process.poll() is not None
            hits = [x for x in list(self.lines) if all(w in x for w in words)]
            hit = hits[times - 1] if len(hits) >= times else None
            assert hit or not over or self._drained(), f"it ended:\n{self.text}"
            return hit

        try:
            return eventually(found, f"a line with {words}", seconds)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.text}") from None

    def _drained(self):
        return any(thread.is_alive() for thread in self._threads)

    def ends(self, seconds=DEFAULT):
        """Wait for the process to exit; returns the exit code."""
        eventually(
            lambda: self.process.poll() is not None, lambda: f"it ends\n{self.text}", seconds
        )
        for thread in self._threads:
            thread.join(patience(5))
        return self.process.returncode

    def summary(self):
        """The summary printed with --json, after a successful exit."""
        assert self.ends() == 0, self.text
        return json.loads("\n".join(self.output))

    def kill(self, number=signal.SIGKILL):
        self.process.send_signal(number)


class World(Run):
    """`minerva run`, and the processes of its members."""

    def __init__(self, path, *words, inside=()):
        super().__init__(path.parent, "run", path, *words, inside=inside)
        self.path = path
        self.name = path.stem
        self.pids = {}

    def __exit__(self, *exc):
        self.look()
        super().__exit__(*exc)
        for pid in self.pids.values():
            if alive(pid):
                os.kill(pid, signal.SIGKILL)

    def registered(self):
        """Its registry entry with endpoint and process id, or None."""
        try:
            registration = json.loads((self.folder / "runtime" / f"{self.name}.json").read_text())
        except (OSError, ValueError):
            return None
        return registration

    def endpoint(self):
        """Its endpoint; waits until there is one."""
        return eventually(self._found, f"{self.name} is there\n{self.text}")["endpoint"]

    def _found(self):
        assert self.process.poll() is None, f"it ended:\n{self.text}"
        return self.registered()

    def client(self):
        return Client(self.endpoint(), self.name)

    def members(self):
        """Its members by name; empty if it does not respond."""
        if self.registered() is None or self.process.poll() is not None:
            return {}
        try:
            with self.client() as asked:
                status = asked.operator.status()
        except (BusError, AssertionError):
            return {}
        self.frame = status.frame
        strange = (0, os.getpid())
        self.pids |= {
            member.name: member.pid for member in status.members if member.pid not in strange
        }
        return {member.name: asdict(member) for member in status.members}

    def coordinator(self):
        """The process id of the coordinator: the launcher's only child that is not a member."""

        def alone():
            members = {member["pid"] for member in self.members().values()}
            others = set(children(self.process.pid)) - members
            return others if members and len(others) == 1 else None

        return eventually(alone, f"a coordinator\n{self.text}").pop()

    def kill_coordinator(self):
        """Kill the coordinator and wait for its successor, which begins no frame once more."""
        pid, frame = self.coordinator(), self.frame
        os.kill(pid, signal.SIGKILL)

        def followed():
            return self.members() and pid not in children(self.process.pid)

        eventually(followed, f"another coordinator\n{self.text}")
        # A world that runs once more from frame 0 has the same digest at its end.
        assert self.frame >= frame, self.text

    def look(self):
        """Record all processes below the launcher."""
        for pid in below(self.process.pid):
            self.pids.setdefault(f"pid {pid}", pid)

    def runs(self, *names):
        """Wait until these members are present and frames advance; returns pids by name."""

        def here():
            members = self.members()
            present = all(members.get(name, {}).get("state") == "present" for name in names)
            return members if members and present and self.frame > 0 else None

        members = eventually(here, f"{names} take part\n{self.text}")
        self.look()
        pids = {name: members[name]["pid"] for name in names}
        # Tests signal them, and 0 would be the tests' own group.
        assert all(pid > 1 for pid in pids.values()), pids
        return pids

    def gone(self):
        """Wait until all of its processes have exited."""
        pids = set(self.pids.values())
        eventually(lambda: not any(map(alive, pids)), f"of {self.pids} some are left")


def children(pid):
    """The child processes of a process."""
    return _by_parent().get(pid, [])


def below(pid):
    """All descendants of a process."""
    parents, processes, rest = _by_parent(), [], [pid]
    while rest:
        children = parents.get(rest.pop(), [])
        processes += children
        rest += children
    return processes


def _by_parent():
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text()
            except OSError:
                continue
            parents.setdefault(int(stat.rpartition(")")[2].split()[1]), []).append(int(entry.name))
    return parents


def alive(pid):
    """Whether a process runs (a zombie does not)."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] not in "ZX"
