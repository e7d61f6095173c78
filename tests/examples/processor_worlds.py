"""Run worlds in this process and print the digests of their frames and events as JSON.

    python processor_worlds.py [nudged]

`test_processors.py` runs this with parts of the processor's instruction set disabled. That changes
the results of functions such as sine for only about one in a thousand values; `nudged` changes all
results of Python's math and numpy by one unit in the last place.
"""

import hashlib
import json
import math
import sys
import tempfile
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np

MATH = "sin cos tan asin acos atan atan2 sinh cosh tanh exp exp2 expm1 log log1p log2 log10 cbrt"
MATH += " pow hypot dist gamma lgamma erf"
NUMPY = "sin cos tan arcsin arccos arctan arctan2 sinh cosh tanh exp exp2 expm1 log log1p log2"
NUMPY += " log10 cbrt power float_power hypot logaddexp dot inner vdot matmul einsum convolve"
LINALG = "inv norm solve eigh svd lstsq"


def nudged(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with a changed last bit, except for exact results (0, ±1, inf, nan)."""

    @wraps(function)
    def other(*args: Any, **options: Any) -> Any:
        value = function(*args, **options)
        if isinstance(value, float):
            return (
                value if value in (0.0, 1.0, -1.0) else type(value)(np.nextafter(value, math.inf))
            )
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            exact = (value == 0) | (np.abs(value) == 1)
            return np.where(exact, value, np.nextafter(value, np.inf))
        return value

    return other


if __name__ == "__main__" and "nudged" in sys.argv:  # before other modules import these names
    for module, names in ((math, MATH), (np, NUMPY), (np.linalg, LINALG)):
        for name in names.split():
            setattr(module, name, nudged(getattr(module, name)))

from example_runs import EXAMPLES, Run  # noqa: E402

import minerva_agents.robot  # noqa: E402

ROBOT = Path(minerva_agents.robot.__file__).with_name("robot.toml")
NOISE = {
    "laser_noise": "0.02", "drive_noise": "0.05", "turn_noise": "2", "alpha1": "0.01",
    "alpha2": "0.01", "alpha3": "0.01", "alpha4": "0.01", "laser_short": "0.1",
    "laser_random": "0.05",
}  # fmt: skip
WORLDS = {
    "robot": ("robot", 12, {"localise": "matching", **NOISE}),
    "robots": ("robots/robots.toml", 8, {}),
    "meadow": ("meadow/meadow.toml", 40, {}),
    "flock": ("flock/flock.toml", 12, {"birds": "100"}),
    "crowd": ("crowd/crowd.toml", 20, {}),
    "plants": ("plants/plants.toml", 8, {}),
    "traffic": ("traffic/traffic.toml", 20, {}),
    "village": ("village/village.toml", 30, {}),
    "warehouse": ("warehouse/warehouse.toml", 30, {}),
    "forager": ("evolution/forager.toml", 20, {}),
}

DRAWING = """
import numpy as np
from minerva_bus import Agent, EventType, Vocabulary, on, portable

class Walker(Agent, symbol="AWalker"):
    x: float = 0.0
    wait: float = 0.0

    @on("eTick")
    def walk(self, tick, moment):
        self.x += moment.chance.normal(0, 0.5)
        self.wait = moment.chance.exponential(3.0) + portable.power(abs(self.x) + 1, 0.3)

class Drifter(Agent, symbol="ADrifter"):
    x: float = 0.0
    wait: float = 0.0

    @on("eTick", population=True)
    def walk(self, tick, moment):
        self.x += moment.chance.normal(0, 0.5)
        self.wait = moment.chance.exponential(3.0) + portable.power(np.abs(self.x) + 1, 0.3)

vocabulary = Vocabulary.of(EventType("eTick"), Walker, Drifter)

def scene(options):
    return Walker.many("w", 200) + Drifter.many("d", 2000)
"""
DRAWING_WORLD = """
[world]
vocabulary = "drawing:vocabulary"
scene = "drawing:scene"
seed = 3
[process.walkers]
agents = ["drawing:Walker", "drawing:Drifter"]
[process.clock]
service = "each"
event = "eTick"
"""


def results(path: Path, frames: int, options: dict[str, str]) -> list[str]:
    # numba takes functions of numpy for what they are, and machine code calls none of them.
    run = Run(path, frames, compiled=False if "nudged" in sys.argv else None, **options)
    events = [
        hashlib.blake2b(str(event).encode(), digest_size=8).hexdigest() for event in run.events
    ]
    return [f"{digest} {hashed}" for digest, hashed in zip(run.digests, events, strict=True)]


def main() -> None:
    digests = {}
    for name, (path, frames, options) in WORLDS.items():
        world = ROBOT if path == name else EXAMPLES / path
        digests[name] = results(world, frames, options)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "drawing.py").write_text(DRAWING, encoding="utf-8")
        Path(folder, "drawing.toml").write_text(DRAWING_WORLD, encoding="utf-8")
        digests["drawing"] = results(Path(folder, "drawing.toml"), 10, {})
    json.dump(digests, sys.stdout)


if __name__ == "__main__":
    main()
