"""Code of a world that ends the program while `check` imports, calls or creates it."""

import os
import signal
import subprocess
import sys

import pytest

from minerva_bus.errors import WorldFileError
from minerva_bus.launch.specs import load
from minerva_bus.launch.world_code import world_code

WORLD = """
[world]
string = "ACar#car"
vocabulary = "endless:vocabulary"
frames = 3

[process.cars]
agents = "endless:Car"
"""

CODE = """
import os, sys
from minerva_bus import Agent, EventType, Vocabulary, on

eGo = EventType("eGo")


class Car(Agent, symbol="ACar"):
    @on("eGo")
    def go(self, event, moment):
        pass


vocabulary = Vocabulary.of(eGo, Car)
"""


def checked(folder, code):
    (folder / "endless.py").write_text(CODE + code)
    (folder / "endless.toml").write_text(WORLD)
    words = [sys.executable, "-m", "minerva_bus", "check", "endless.toml"]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("os._exit(0)", "SystemExit: 0; code of a world must not exit"),
        ("os._exit(7)", "SystemExit: 7; code of a world must not exit"),
        ("sys.exit()", "code of a world must not exit"),
        ("raise KeyboardInterrupt", "code of a world must not raise KeyboardInterrupt"),
        ("raise KeyboardInterrupt('x') from None", "must not raise KeyboardInterrupt"),
    ],
)
def test_code_that_ends_the_program_is_named(tmp_path, code, said):
    done = checked(tmp_path, f"\n{code}\n")
    assert done.returncode == 1
    assert said in done.stderr
    assert "endless.py:" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_interrupt_is_no_mistake_of_the_code():
    with pytest.raises(KeyboardInterrupt), world_code():
        signal.raise_signal(signal.SIGINT)


def test_children_and_other_threads_may_end_the_process():
    """As a library does that starts a process by `fork`."""
    program = "\n".join(
        [
            "import os, threading",
            "from minerva_bus.launch.world_code import world_code",
            "with world_code():",
            "    if not (child := os.fork()):",
            "        os._exit(5)",
            "    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 5",
            "    threading.Thread(target=os._exit, args=(6,)).start()",
            "    threading.Event().wait()",
        ]
    )
    assert subprocess.run([sys.executable, "-c", program], timeout=60).returncode == 6


def test_afterwards_a_program_may_end_itself(tmp_path, monkeypatch):
    end = os._exit
    (tmp_path / "ends_itself.py").write_text("import os\nos._exit(3)\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(WorldFileError, match="must not exit"):
        load("ends_itself:vocabulary", tmp_path)
    assert os._exit is end
