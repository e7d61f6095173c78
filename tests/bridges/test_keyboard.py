"""The bridge to the keys of a terminal, over a pseudo terminal."""

import os
import pty
import sys
import termios
from pathlib import Path

import pytest

from minerva_bus import EventType, MetresPerSecond, MinervaError, Vocabulary, WorldInfo
from minerva_services.input.keyboard import Keyboard
from minerva_services.input.keyboard.service import KeyDecoder

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
from running import MINERVA, World, environment
from running import eventually as patiently

from minerva_services.bridging.testing import RunningBridge

eSpeed = EventType("eSpeed", speed=MetresPerSecond)
eObjective = EventType("eObjective", marker=str)
WORLD = WorldInfo("yard", Vocabulary.of(eSpeed, eObjective), 0, 0.1)


class Desk:
    """A pseudo terminal on which a test types."""

    def __init__(self):
        self.keys, self._screen = pty.openpty()
        self.path = os.ttyname(self._screen)
        self.gone = False

    def type(self, text):
        os.write(self.keys, text.encode())

    @property
    def mode(self):
        return termios.tcgetattr(self._screen)

    @property
    def echoes(self):
        return bool(self.mode[3] & termios.ECHO)

    def leave(self):
        if not self.gone:
            self.gone = True
            os.close(self.keys)
            os.close(self._screen)


@pytest.fixture
def desk():
    made = Desk()
    yield made
    made.leave()


def keyboard(desk, **options):
    made = Keyboard(terminal=desk.path, **options)
    made.joined(WORLD)
    return made


def typed(desk, text, **options):
    """The events that some typed keys cause."""
    made = keyboard(desk, **options)
    with RunningBridge(made) as runs:
        desk.type(text)
        keys = KeyDecoder()
        count = len([*keys.named(text.encode()), *keys.named(b"")])
        runs.wait_for(
            lambda: runs.counted("events") + runs.counted("other keys") == count, "keys arrive"
        )
    return runs.emitted


def test_arrows_change_the_speed_within_bounds(desk):
    speeds = [event.speed for event in typed(desk, "\x1b[A\x1bOA\x1b[A\x1b[B", step=0.4)]
    assert speeds == [0.4, 0.8, 1.0, 0.6]


def test_arrows_begin_at_the_given_offset(desk):
    assert typed(desk, "\x1b[B", begin=0.8) == [eSpeed(0.7)]


def test_digits_choose_among_markers(desk):
    assert typed(desk, "213", markers="kitchen, bath") == [
        eObjective("bath"),
        eObjective("kitchen"),
    ]


def test_keys_of_ones_own_go_first(desk):
    keys = {"w": "eSpeed speed=0.8", "space": "eSpeed 0", "ä": "eObjective hall", "up": "eSpeed 1"}
    made = typed(desk, "w ä\x1b[A", keymap=keys, to="r1")
    events = [eSpeed(0.8), eSpeed(0.0), eObjective("hall"), eSpeed(1.0)]
    assert [(event.type, event.values, event.receivers) for event in made] == [
        (event.type, event.values, ("r1",)) for event in events
    ]


def test_other_keys_are_counted(desk):
    made = keyboard(desk)
    with RunningBridge(made) as runs:
        desk.type("x\x1b[5~\x1b")
        runs.wait_for(lambda: runs.counted("other keys") == 3, "keys arrive")
    assert runs.emitted == []


def test_it_follows_its_options():
    assert Keyboard().generates() == ("eSpeed",)
    assert Keyboard(markers=["a"]).generates() == ("eObjective", "eSpeed")
    assert Keyboard(slide="", keymap={"a": "eStop"}).generates() == ("eStop",)


def test_the_terminal_is_left_as_it_was(desk):
    before = desk.mode
    made = keyboard(desk)
    assert not desk.echoes
    with RunningBridge(made) as runs:
        desk.type("\x1b[A")
        runs.wait_for(lambda: runs.emitted, "it arrives")
    assert desk.mode == before
    made.close()
    assert desk.mode == before


def test_a_terminal_that_goes_away_is_the_end(desk, capsys):
    with RunningBridge(keyboard(desk)) as runs:
        desk.leave()
        runs.wait_for(runs.ended, "it has ended")
    assert runs.error is None
    assert "the keyboard has ended" in capsys.readouterr().out


def test_a_missing_terminal_is_reported_with_alternatives(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(
        MinervaError, match=r"is not a terminal .*attach the keyboard from a terminal"
    ):
        Keyboard(terminal=str(tmp_path / "file")).joined(WORLD)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"keymap": {"w": "eSped speed=1"}}, "keyboard: .* no event type eSped; did you mean"),
        ({"markers": list("abcdefghijk")}, "11 markers; there are only ten digits"),
        ({"keymap": {"spce": "eSpeed 1"}}, "keymap.spce: no key has this name; .* space, enter"),
        ({"keymap": {" ": "eSpeed 1"}}, "keymap. : no key has this name"),
        ({"low": 1.0}, "low must be below high"),
    ],
)
def test_wrong_options(desk, options, problem):
    with pytest.raises(MinervaError, match=problem):
        keyboard(desk, **options)
    assert desk.echoes


def test_names_of_keys():
    keys = KeyDecoder()
    assert list(keys.named("aÄ 1\r\t\x7f".encode())) == [
        *("a", "Ä", "space", "1", "enter", "tab", "backspace")
    ]
    assert list(keys.named(b"\xc3")) == []
    assert list(keys.named(b"\xa4\x1b[1;5A\x1b[3~\x01")) == ["ä", "up", "", ""]


def test_an_escape_sequence_may_be_split_between_two_reads():
    data = b"a\x1b[1;5Ab\x1bOB\x1b[3~"
    for place in range(len(data) + 1):
        keys = KeyDecoder()
        names = [*keys.named(data[:place]), *keys.named(data[place:])]
        assert names == ["a", "up", "b", "down", ""], place


def test_a_pause_distinguishes_the_escape_key_from_a_sequence():
    keys = KeyDecoder()
    assert list(keys.named(b"a\x1b")) == ["a"]
    assert list(keys.named(b"")) == ["escape"]
    assert list(keys.named(b"\x1b")) == []
    assert list(keys.named(b"x\x1b\x1b[")) == ["escape", "x", "escape"]
    assert list(keys.named(b"")) == ["escape", "["]
    assert list(keys.named(b"")) == []


def test_a_sequence_without_an_end_does_not_accumulate():
    keys = KeyDecoder()
    assert list(keys.named(b"\x1b[" + b"1" * 100)) == ["escape", "[", *"1" * 100]


# --- a world with a keyboard in a terminal ---

MODULE = """
from minerva_bus import Agent, EventType, MetresPerSecond, Vocabulary, on

eSpeed = EventType("eSpeed", speed=MetresPerSecond)
eTick = EventType("eTick")


class Cart(Agent, symbol="ACart"):
    speed: MetresPerSecond = 0.0

    @on("eSpeed")
    def drive(self, order, moment):
        self.speed = order.speed


vocabulary = Vocabulary.of(eSpeed, eTick, Cart)
"""
FILE = """
[world]
string = "ACart#r1"
vocabulary = "keyed:vocabulary"
rate = 50

[process.carts]
agents = "keyed:Cart"

[process.ticks]
service = "each"
event = "eTick"
"""


def attached(desk, world):
    """Run `minerva attach keyboard` in a new terminal; returns its process id."""
    pid = os.fork()
    if pid:
        return pid
    try:
        os.setsid()
        for file in (0, 1, 2):
            os.dup2(os.open(desk.path, os.O_RDWR), file)
        os.chdir(world.folder)
        words = ["attach", "keyboard", "--world", world.name, "--name", "keys"]
        os.execve(MINERVA[0], [*MINERVA, *words], environment(world.folder))
    finally:
        os._exit(127)


def test_attached_to_a_world_from_a_terminal(desk, tmp_path):
    (tmp_path / "keyed.py").write_text(MODULE)
    name = f"keyed-{os.getpid()}"
    (tmp_path / f"{name}.toml").write_text(FILE)
    before = desk.mode
    with World(tmp_path / f"{name}.toml") as world:
        world.runs("carts")
        pid = attached(desk, world)
        world.runs("keys")
        patiently(lambda: not desk.echoes, "it listens to the terminal")
        desk.type("\x1b[A\x1b[A\x1b[A")
        with world.client() as asked:
            patiently(lambda: "speed=0.3" in asked.ask("scene")["scene"], "the order arrives")
        desk.type("\x03")
        _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 0
    assert desk.mode == before
