"""Code that provokes the messages of docs/troubleshooting.md.

`RAISED` maps a quoted message to code that raises it, `PRINTED` to code that returns the text in
which it is printed. Each is called in an empty folder.
"""

from __future__ import annotations

import errno
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, redirect_stderr, redirect_stdout, suppress
from functools import cache
from io import BytesIO, StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from minerva_bus import Agent, EventType, Generator, Vocabulary, World, each, evolve, on, parse, run
from minerva_bus.cli.main import app
from minerva_bus.errors import BusError, MisuseError
from minerva_bus.frame import messages as m
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.launch.registry import WorldLock
from minerva_bus.launch.run_outputs import find_past
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.log.journal import Journal
from minerva_bus.runtime.joining import Arrival
from minerva_bus.runtime.pace import Overruns
from minerva_bus.runtime.participants import MemberProcess
from minerva_bus.runtime.session import open_hub
from minerva_bus.security.credentials import key_folder
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.keys import COORDINATOR, Keys
from minerva_services.bridges.rosbag import open_bag
from minerva_services.sensors.carmen.log import CarmenLog
from minerva_services.views.opengl.canvas import without_window
from minerva_services.views.sprites import Sprites
from minerva_services.web_access import WebAccess

eTick = EventType("eTick")
eAdd = EventType("eAdd", amount=float)


class Counter(Agent, symbol="ACounter"):
    """Counts, or fails as the event requests."""

    total: float = 0.0

    @on("eTick")
    def divide(self, tick: Any, moment: Any) -> None:
        self.total = 1.0 / self.total

    @on("eAdd")
    def add(self, event: Any, moment: Any) -> None:
        self.total = "one"  # type: ignore[assignment]


class Sleeper(Counter):
    """Blocks at each tick."""

    @on("eTick")
    def divide(self, tick: Any, moment: Any) -> None:
        time.sleep(60)


class Herd(Agent, symbol="AHerd"):
    """A population with an invalid row."""

    total: float = 0.0

    @on("eTick", population=True)
    def grow(self, tick: Any, moment: Any) -> None:
        self.total = self.total + np.inf


class Picky(Generator, events=("eTick",)):
    """A generator that cannot run in any world, or fails when it joins."""

    def __init__(self, error: Exception) -> None:
        self._error = error

    def joined(self, world: Any) -> None:
        raise self._error


VOCABULARY: Final = Vocabulary.of(eTick, eAdd, Counter, Herd)


def command(*words: str) -> Callable[[Path], object]:
    return lambda _: app(list(words), standalone_mode=False)


def signature(_: Path) -> object:
    class Late(Agent, symbol="ALate"):
        @on("eTick")
        def count(self, tick: Any) -> None: ...

    return Late


def population(_: Path) -> object:
    return evolve(Herd.many("a", 3, total=np.zeros(3)), [eTick()], [Herd])


def state(_: Path) -> object:
    return evolve(parse("ACounter#a<total=0>"), [eAdd(1.0)], [Counter])


def joins(error: Exception) -> Callable[[Path], object]:
    """Welcome a member whose service then fails."""
    return lambda _: Member("lidar", Picky(error)).receive(welcome())


def welcome(seed: int = 1, frame: int = 5) -> m.Welcome:
    return m.Welcome("yard", VOCABULARY, seed, 0.1, frame)


def restarted(_: Path) -> object:
    member = Member("fox", None, [Counter])
    member.receive(welcome())
    return member.receive(welcome(seed=2, frame=0))


def revoked(_: Path) -> object:
    return Member("fox", None, [Counter]).receive(m.Refused("its certificate was revoked"))


def world_file(folder: Path, tail: str = "", agent: str = "Counter") -> Path:
    """A world file of counters, with its module; `tail` continues the counters' process."""
    code = f"from minerva_bus import each\nfrom troubles import VOCABULARY, {agent}, eTick\n"
    (folder / "counters.py").write_text(code, encoding="utf-8")
    path = folder / "counters.toml"
    path.write_text(
        '[world]\nstring = "ACounter#a<total=1>"\nvocabulary = "counters:VOCABULARY"\nframes = 50\n'
        '[process.ticks]\nservice = "each"\nevent = "eTick"\n'
        f'[process.counters]\nagents = "counters:{agent}"\n{tail}',
        encoding="utf-8",
    )
    return path


def followed(folder: Path) -> object:
    algorithm = FrameAlgorithm(read_world_file(world_file(folder)).world)
    first = Journal(folder / "yard.journal", 7, algorithm)
    Journal(folder / "yard.journal", 8, algorithm)
    return first.rewrite()


def written(name: str, content: str, *words: str) -> Callable[[Path], object]:
    """Run a command after a file is written."""

    def provoke(folder: Path) -> object:
        (folder / name).write_text(content, encoding="utf-8")
        return command(*words)(folder)

    return provoke


def carmen(folder: Path) -> object:
    (folder / "other.log").write_text("no log at all\n", encoding="utf-8")
    with closing(CarmenLog(folder / "other.log", lambda *_: None)) as log:
        return list(log.readings())


def cut_bag(folder: Path) -> object:
    (folder / "cut.mcap").write_bytes(b"\x89MCAP0\r\n")
    return open_bag(folder / "cut.mcap", lambda *_: None)


def taken_port(_: Path) -> object:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        return open_hub(COORDINATOR, f"tcp/127.0.0.1:{port}")


def taken_name(_: Path) -> object:
    lock = WorldLock("hut")
    try:
        return WorldLock("hut")
    finally:
        lock.release()


def no_journal(folder: Path) -> object:
    return find_past(read_world_file(world_file(folder)), again=True)


def no_library(_: Path) -> object:
    with patch("importlib.util.find_spec", lambda name: None):
        return Sprites(path="a.png")


def not_compilable(_: Path) -> object:
    class Printer(Agent, symbol="APrinter"):
        @on("eTick", compiled=True)
        def show(self, tick: Any, moment: Any) -> None:
            print(tick)

    return Printer


def no_display(_: Path) -> object:
    with patch.dict(os.environ):
        for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
            os.environ.pop(name, None)
        return Sprites()


def no_driver(_: Path) -> object:
    with patch("moderngl.create_context", side_effect=Exception("no EGL")):
        return without_window()


def no_token(_: Path) -> str:
    page = WebAccess("127.0.0.1", 8080, "secret")
    return page.refusal("/", {"Host": "127.0.0.1:8080"})


def late_frame(_: Path) -> str:
    overruns = Overruns()
    reports: list[str] = []
    for frame in range(20):
        overruns.began(0.1, float(frame))
        overruns.answered("evolution", "foxes", frame + 0.25)
        reports.append(overruns.done(frame, frame + 0.3))
    return "\n".join(reports)


def printed(*words: str) -> Callable[[Path], str]:
    """Output of a command in this process."""

    def provoke(folder: Path) -> str:
        out = StringIO()
        with redirect_stdout(out), redirect_stderr(out), suppress(SystemExit):
            command(*words)(folder)
        return out.getvalue()

    return provoke


def truncated(folder: Path) -> str:
    printed("run", str(world_file(folder)), "--in-process", "--record", "a.mcap")(folder)
    content = (folder / "a.mcap").read_bytes()
    (folder / "a.mcap").write_bytes(content[: len(content) // 2])
    return printed("info", "a.mcap")(folder)


class FullDisk(BytesIO):
    """A file on a disk that fills up after the header."""

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > 5_000:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


def full_disk(folder: Path) -> str:
    with patch("minerva_bus.log.recorder.open_for_record", lambda *_, **__: FullDisk()):
        path = world_file(folder)
        return printed("run", str(path), "--in-process", "--record", "a.mcap")(folder)


def other_digest(folder: Path) -> str:
    for seed in ("1", "2"):
        words = "run", "meadow", "--in-process", "--frames", "5", "--seed", seed, "--record"
        printed(*words, f"{seed}.mcap")(folder)
    return printed("diff", "1.mcap", "2.mcap")(folder)


def busy(_: Path) -> str:
    lines: list[str] = []
    with suppress(BusError):
        join("yard", "fox", lines.append)
    return "\n".join(lines)


SOON: Final = 'on_failure = "stop"\n[bus]\nsoft = 0.3\nhard = 1.0\n'


@cache
def blocked() -> str:
    """Output of a world with an agent that blocks."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        path = world_file(folder, SOON, "Sleeper")
        return subprocess.run(
            [sys.executable, "-m", "minerva_bus.cli.main", "run", str(path)],
            cwd=folder, capture_output=True, text=True, check=False,
            env={**os.environ, "MINERVA_RUNTIME_DIR": name, "PYTHONPATH": str(Path(__file__).parent)},
        ).stderr  # fmt: skip


def tick(text: str = "ACounter#a") -> Callable[[Path], object]:
    """Run a world of counters for one frame."""
    return lambda _: run(World(text, agents=[Counter], services=[each(eTick)]), frames=1)


def attach(endpoint: str) -> Callable[[Path], object]:
    return command("attach", "svg", "--connect", endpoint)


def no_authority(folder: Path) -> object:
    return key_folder(folder / "keys").credentials("fox")


@contextmanager
def silent_world() -> Iterator[str]:
    """The endpoint of a world `yard` whose coordinator does nothing; it has a member `ground`."""
    session, endpoint = open_hub(COORDINATOR)
    liveliness, keys = session.liveliness(), Keys("yard")
    tokens = [liveliness.declare_token(keys.alive(name)) for name in (COORDINATOR, "ground")]
    with session:
        yield endpoint
        for token in tokens:
            token.undeclare()


def join(world: str, name: str, notify: Callable[[str], None] = print) -> None:
    arrival = Arrival(seen=0.1, named=0.1, greeted=0.2, greeted_at_most=0.3)
    member = Member(name, None, [Counter])
    with silent_world() as endpoint:
        MemberProcess([member], world, endpoint, notify, arrival=arrival).run()


def no_message(_: Path) -> object:
    return Decoder(VOCABULARY).from_member("fox", b"\xc1")


RAISED: Final[Mapping[str, Callable[[Path], object]]] = {
    # --- worlds and options ---
    "there is no world 'nowhere'; installed are": command("run", "nowhere"),
    "there is no world file nowhere.toml": command("run", "nowhere.toml"),
    "Expected ']' at the end of a table declaration": written("w.toml", "[world", "run", "w.toml"),
    "robot has no option --frams; did you mean '--frames'?": command(
        "run", "robot", "--frams", "3"
    ),
    "unexpected word 'what': write options as --name value": command("run", "meadow", "what"),
    "world has no end: run(world, frames=300); 0: no limit": lambda _: run(
        World("ACounter#a", agents=[Counter], services=[each(eTick)])
    ),
    # --- strings and values ---
    "expected a symbol of P, T or A": lambda _: parse("ACounter#a ("),
    "the vocabulary has no ACuonter; did you mean 'ACounter'?": tick("ACuonter#a"),
    "eAdd: amount must be a number, not 'x'": lambda _: eAdd("x"),
    "ACounter#a: total must be a number, not 'one'": state,
    "total must be a finite number, not inf": population,
    # --- code ---
    "an activity takes (self, event, moment)": signature,
    "Picky.joined: KeyError: 'map'": joins(KeyError("map")),
    "Counter.divide of ACounter#a at eTick in frame 0: ZeroDivisionError": tick(),
    "agents failed in frame 0": tick(),
    # --- records ---
    "there is no journal, so no other coordinator can continue the world": no_journal,
    "not an MCAP file": written("bad.mcap", "x", "info", "bad.mcap"),
    "cannot be written: No such file or directory": command(
        "run", "meadow", "--in-process", "--frames", "1", "--record", "/nowhere/a.mcap"
    ),
    "no readings; expected a CARMEN log": carmen,
    "it ends too early, as if its recorder had been killed": cut_bag,
    # --- running worlds ---
    "no world 'nowhere' runs on this machine": command("list", "--world", "nowhere"),
    "a world 'hut' runs here already": taken_name,
    "Address already in use; choose another port, or port 0 for any that is free": taken_port,
    "has no authority (ca.pem); create one with minerva keys init": no_authority,
    "would admit anyone who can reach it, with all permissions": command(
        "run", "meadow", "--listen", "tcp/0.0.0.0:0", "--frames", "1"
    ),
    "another coordinator runs the world": followed,
    # --- members from elsewhere ---
    "nothing listens at port 9 of 127.0.0.1": attach("tcp/127.0.0.1:9"),
    "there is no host 'nowhere.invalid'": attach("tcp/nowhere.invalid:9"),
    "requires a certificate; name your keys with --keys FOLDER": attach("tls/127.0.0.1:9"),
    "there is a member 'ground' in the world already; end it first, or choose another name (--name; with keys, the certificate of another name)": lambda _: (
        join("yard", "ground")
    ),
    "there is no world 'hut' at": lambda _: join("hut", "fox"),
    "the world does not take fox": revoked,
    "lidar cannot take part: the vocabulary has no eScan": joins(
        MisuseError("the vocabulary has no eScan")
    ),
    "the world 'yard' has restarted, at frame 0": restarted,
    "this is not msgpack": no_message,
    # --- slow worlds ---
    "cannot be compiled: the function print": not_compilable,
    # --- pictures ---
    "sprites: it needs pygame": no_library,
    "there is no display to open a window on": no_display,
    "opengl: no driver for OpenGL 3.3": no_driver,
}
"""Code that raises an error with the text."""

PRINTED: Final[Mapping[str, Callable[[Path], str]]] = {
    "has been waiting for it for": lambda _: blocked(),
    "no answer for 1 s: killing it; it is blocked in": lambda _: blocked(),
    "the world is busy; waiting for its greeting": busy,
    "is the first that differs": other_digest,
    "took 0.300 s instead of 0.100 s": late_frame,
    "cut off: its world did not end as it should": truncated,
    "No space left on device; the world continues without a record": full_disk,
    "the token is missing or wrong: open the whole address that was printed": no_token,
}
"""Code that returns what is printed."""
