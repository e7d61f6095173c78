"""A rule that never ends can be interrupted, and its line is known."""

import subprocess
import sys

import pytest

pytest.importorskip("numba")

ENDLESS = """
import signal
import traceback

import numpy as np

from minerva_bus import Cells, EventType, evolve, on
from minerva_fast import ORDERED, SHUFFLED, Draws, Space, kernel, rule
from minerva_bus.world.context import Frame

eStep = EventType("eStep", end=int)


@kernel
def descend(k, end):
    while k > end:
        k -= 0 if end < 0 else 1
    return k


@rule(ORDERED)
def in_loop(cell: int, grass: Cells, end: int):
    k = 5
    while k > end:
        k -= 0 if end < 0 else 1
    grass[cell] += k


@rule(SHUFFLED)
def in_kernel(cell: int, grass: Cells, end: int, draws: Draws):
    grass[cell] = descend(5, end)


class Meadow(Space, symbol="AMeadow"):
    grass: Cells

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, RULE, end=step.end)


meadow = Meadow("m", width=3, height=2, grass=np.zeros((2, 3), np.int16)).string
evolve(meadow, [eStep(end=2)], [Meadow], Frame(0))  # compiles
names = "in_loop", "in_kernel", "descend"


def interrupt(number, frame):
    if frame.f_code.co_name in names:
        raise KeyboardInterrupt


signal.signal(signal.SIGVTALRM, interrupt)
signal.setitimer(signal.ITIMER_VIRTUAL, 0.1, 0.1)
try:
    evolve(meadow, [eStep(end=-1)], [Meadow], Frame(0))
except KeyboardInterrupt as interrupted:
    signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    places = traceback.extract_tb(interrupted.__traceback__)
    print(*[each.name for each in places if each.name in names])
"""


@pytest.mark.parametrize(
    ("rule", "names"), [("in_loop", "in_loop"), ("in_kernel", "in_kernel descend")]
)
def test_a_rule_that_never_ends_can_be_interrupted(rule, names, tmp_path):
    script = tmp_path / "endless.py"
    script.write_text(ENDLESS.replace("RULE", rule), encoding="utf-8")
    # In another process, which can be killed if it cannot be interrupted.
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=False
    )
    assert done.stdout.split("\n") == [names, ""], done.stderr
