"""The gamepad bridge: with a gamepad of the test, and with a virtual one of SDL."""

import ctypes
import threading
from pathlib import Path

import pytest

from minerva_bus import EventType, MetresPerSecond, MinervaError, Vocabulary, WorldInfo
from minerva_services.bridging import SourceError
from minerva_services.bridging.testing import RunningBridge
from minerva_services.input.gamepad import Gamepad
from minerva_services.input.gamepad.service import PadState
from tests.patience import patience

pygame = pytest.importorskip("pygame", reason="the extra `gamepad` is not installed")

eSpeed = EventType("eSpeed", speed=MetresPerSecond)
eObjective = EventType("eObjective", marker=str)
eErrand = EventType("eErrand", source=str, target=str)
WORLD = WorldInfo("yard", Vocabulary.of(eSpeed, eObjective, eErrand), 0, 0.1)


class OwnPad:
    """A gamepad whose state the test sets."""

    name = "the test's own"

    def __init__(self):
        self.now = PadState((0.0, 0.0), frozenset())
        self.looked = 0
        self.closed = False
        self._look = threading.Condition()

    def state(self):
        with self._look:
            self.looked += 1
            self._look.notify_all()
            return self.now

    def wait_for_looks(self, looks):
        """Wait until it has been polled that many more times."""
        with self._look:
            seen = self.looked + looks
            assert self._look.wait_for(lambda: self.looked >= seen, patience()), (
                "nobody looks at it"
            )

    def close(self):
        self.closed = True

    def hold(self, push=0.0, *buttons):
        """Hold the stick and buttons until the bridge has polled this state."""
        self.now = PadState((0.0, -push), frozenset(buttons))
        self.wait_for_looks(2)

    def pull_out(self):
        self.now = None


@pytest.fixture
def slot(monkeypatch):
    """The list of connected gamepads, initially empty."""
    pads = []

    def open_own(number):
        if not pads:
            raise SourceError(f"there is no gamepad {number}: none is plugged in")
        return pads[-1]

    monkeypatch.setattr("minerva_services.input.gamepad.service.open_pad", open_own)
    return pads


def gamepad(**options):
    made = Gamepad(**options)
    made.joined(WORLD)
    return made


def test_a_stick_gives_speeds_and_rest_when_it_is_let_go(slot):
    pad = OwnPad()
    slot.append(pad)
    with RunningBridge(gamepad(high=0.8)) as runs:
        pad.wait_for_looks(1)
        for push in (0.1, 0.575, 1.0, 1.0, -1.0, 0.0):
            pad.hold(push)
    assert runs.emitted == [eSpeed(0.4), eSpeed(0.8), eSpeed(0.0)]
    assert pad.closed


def test_pulled_it_goes_back_where_that_is_wanted(slot):
    pad = OwnPad()
    slot.append(pad)
    with RunningBridge(gamepad(low=-0.5, to="r2, r1")) as runs:
        pad.wait_for_looks(1)
        pad.hold(-1.0)
    assert runs.emitted == [eSpeed(-0.5, receivers=["r1", "r2"])]


def test_buttons_give_markers_and_whatever_is_wanted_when_they_go_down(slot):
    pad = OwnPad()
    slot.append(pad)
    buttons = {"7": "eErrand source=office target='the lab'", "1": "eSpeed 0.5m/s"}
    made = gamepad(markers=["kitchen", "bath"], buttons=buttons)
    assert made.generates() == ("eErrand", "eObjective", "eSpeed")
    with RunningBridge(made) as runs:
        pad.wait_for_looks(1)
        for held in ((0,), (0, 1), (), (0, 7), (9,)):
            pad.hold(0.0, *held)
    kitchen = eObjective("kitchen")
    assert runs.emitted == [kitchen, eSpeed(0.5), kitchen, eErrand("office", "the lab")]
    assert runs.counted("other buttons") == 1


def test_a_missing_gamepad_is_reported_and_awaited(slot, capsys):
    with RunningBridge(gamepad()) as runs:
        runs.wait_for(lambda: runs.counted("failures"), "it is missed")
        assert runs.state == "there is no gamepad 0: none is plugged in"
        pad = OwnPad()
        slot.append(pad)
        pad.wait_for_looks(1)
        pad.hold(1.0)
        assert runs.emitted == [eSpeed(1.0)]
    said = capsys.readouterr().out
    assert "there is no gamepad 0: none is plugged in; retrying\n" in said


def test_a_gamepad_that_is_lost_while_it_is_pushed_lets_go(slot):
    pad = OwnPad()
    slot.append(pad)
    with RunningBridge(gamepad()) as runs:
        pad.wait_for_looks(1)
        pad.hold(1.0)
        slot.clear()
        pad.pull_out()
        runs.wait_for(lambda: runs.counted("failures"), "it is missed")
    assert runs.emitted == [eSpeed(1.0), eSpeed(0.0)]


def test_without_the_axis_there_are_only_buttons(slot):
    pad = OwnPad()
    slot.append(pad)
    with RunningBridge(gamepad(axis=5, markers="kitchen")) as runs:
        pad.wait_for_looks(1)
        pad.hold(1.0, 0)
    assert runs.emitted == [eObjective("kitchen")]


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"slide": "eSped"}, "gamepad: .* no event type eSped; did you mean 'eSpeed'"),
        ({"slide": "eObjective"}, r"eObjective must have one real number; it has marker \(text\)"),
        ({"buttons": {"0": "eSpeed speed=fast"}}, "gamepad: eSpeed speed=fast does not fit: "),
        ({"buttons": {"0": "eSpeed 1 2"}}, "eSpeed 1 2 does not fit: each datum"),
        ({"buttons": {"0": "eErrand office"}}, "eErrand must have one datum; it has source"),
        ({"buttons": {"a": "eSpeed speed=1"}}, "buttons.a: buttons are numbered"),
        ({"buttons": {"0": "Speed"}}, "buttons.0 is 'Speed'; expected an event type"),
        ({"buttons": {"0": "eSpeed ="}}, "buttons.0 is 'eSpeed ='; expected an event type"),
        ({"buttons": "a"}, "buttons must be a table"),
        ({"markers": 3}, "markers must be a list of strings"),
        ({"markers": ["a", 3]}, "markers must be a list of strings"),
        ({"high": 0.0}, "expected dead from 0"),
        ({"step": 0.0}, "step above 0"),
        ({"high": float("inf")}, "finite"),
        ({"pad": -1}, "count from 0"),
    ],
)
def test_wrong_options(options, problem):
    with pytest.raises(MinervaError, match=problem):
        gamepad(**options)


# --- virtual joystick of SDL ---


@pytest.fixture(scope="module")
def sdl():
    """The library that pygame has loaded, which can create virtual joysticks."""
    libraries = Path(pygame.__file__).parent.with_name("pygame_ce.libs").glob("libSDL2-2*")
    path = next(libraries, None)
    if path is None:
        pytest.skip("pygame-ce does not come with an SDL of its own here")
    library = ctypes.CDLL(str(path))
    library.SDL_JoystickOpen.restype = ctypes.c_void_p
    return library


@pytest.fixture
def virtual(sdl):
    """A virtual SDL joystick with four axes and eight buttons; a call connects it."""
    from minerva_services.input.gamepad.service import _begun

    _begun()

    class Virtual:
        def plug(self):
            self.number = sdl.SDL_JoystickAttachVirtual(1, 4, 8, 0)
            assert self.number >= 0
            self.handle = ctypes.c_void_p(sdl.SDL_JoystickOpen(self.number))

        def hold(self, push, *buttons):
            sdl.SDL_JoystickSetVirtualAxis(self.handle, 1, ctypes.c_int16(round(-32767 * push)))
            for button in range(8):
                sdl.SDL_JoystickSetVirtualButton(self.handle, button, int(button in buttons))

        def pull_out(self):
            sdl.SDL_JoystickDetachVirtual(self.number)

    yield Virtual()
    pygame.joystick.quit()  # Only this subsystem: other tests of this process draw text.


def test_a_joystick_of_sdl(virtual):
    with RunningBridge(gamepad(markers=["kitchen", "bath"])) as runs:
        runs.wait_for(lambda: runs.counted("failures"), "it is missed")
        virtual.plug()
        runs.wait_for(lambda: runs.state == "open", "it is there")
        virtual.hold(1.0)
        runs.wait_for(lambda: runs.emitted == [eSpeed(1.0)], "it is pushed")
        virtual.hold(1.0, 1)
        runs.wait_for(lambda: runs.emitted[1:] == [eObjective("bath")], "a button is pressed")
        virtual.pull_out()
        runs.wait_for(lambda: runs.counted("failures") > 1, "it is missed again")
    assert runs.emitted[-1] == eSpeed(0.0)
