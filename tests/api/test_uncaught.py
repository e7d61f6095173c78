"""What a script prints for an error that it does not catch."""

import signal
import subprocess
import sys
import threading

import pytest

from minerva_bus.errors import MisuseError
from minerva_bus.uncaught import install, repeat_interrupts

SNAIL = """
from minerva_bus import Agent, EventType, World, each, on, run

eTick = EventType("eTick")

class Snail(Agent, symbol="ASnail"):
    water: float = 3.0

    @on("eTick")
    def dry(self, tick, moment):
        self.water -= 1 / 0

world = World("ASnail#a", agents=[Snail], services=[each(eTick)])
run(world, frames=3)
"""


def test_an_error_of_a_world_is_reported_without_frames_of_the_framework(tmp_path):
    script = tmp_path / "snail.py"
    script.write_text(SNAIL)
    done = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert done.returncode == 1
    lines = done.stderr.replace(str(tmp_path), "").splitlines()
    assert not any("Traceback" in line or "minerva_bus/" in line for line in lines)
    (start,) = [i for i, line in enumerate(lines) if line.startswith("WorldStopped: ")]
    assert "Snail.dry of ASnail#a at eTick: ZeroDivisionError" in lines[0]
    assert lines[1].endswith("│   /snail.py:11, in Snail.dry")
    assert lines[start:] == [
        "WorldStopped: agents failed in frame 0; the world stops"
        " (MINERVA_TRACEBACK=1 shows all frames)",
        "  /snail.py:14",
        "    run(world, frames=3)",
    ]
    assert len(lines) <= 10


def printed(error, capsys):
    """What the hook prints for an error that has been raised here."""
    try:
        raise error
    except Exception as raised:
        sys.excepthook(type(raised), raised, raised.__traceback__)
    return capsys.readouterr().err


@pytest.fixture
def installed(monkeypatch):
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    install()


def test_the_variable_shows_all_frames(installed, monkeypatch, capsys):
    assert "Traceback" not in printed(MisuseError("no good"), capsys)
    monkeypatch.setenv("MINERVA_TRACEBACK", "1")
    assert "Traceback" in printed(MisuseError("no good"), capsys)


def test_other_errors_keep_their_tracebacks(installed, capsys):
    assert "Traceback" in printed(ValueError("no good"), capsys)


def test_a_hook_of_the_program_stays(monkeypatch):
    monkeypatch.setattr(sys, "excepthook", print)
    install()
    assert sys.excepthook is print


def test_an_interrupt_that_python_cannot_raise_comes_again(monkeypatch, capsys):
    class Closing:
        def __del__(self):
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    repeat_interrupts()
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        Closing()
        with pytest.raises(KeyboardInterrupt):
            threading.Event().wait()
    finally:
        signal.signal(signal.SIGINT, handler)
    assert capsys.readouterr().err == ""


def test_another_error_that_python_cannot_raise_is_printed(monkeypatch, capsys):
    class Closing:
        def __del__(self):
            raise ValueError("lost")

    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    repeat_interrupts()
    Closing()
    assert "ValueError: lost" in capsys.readouterr().err
