"""Runs one model of a Python system, once for each seed that arrives on standard input.

python -m benchmarks.comparison.worker mesa flocking small

Answers each line with an object: the milliseconds of creating and running the model, without the
computation of its statistics.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from importlib import import_module
from typing import Final

from benchmarks.comparison.parameters import MODELS, PARAMETERS, SIZES

PACKAGES: Final = {
    "minerva": "benchmarks.comparison.models",
    "mesa": "benchmarks.comparison.mesa_models",
    "mesa-frames": "benchmarks.comparison.mesa_frames_models",
}


def measured(system: str, model: str, size: str, seed: int) -> dict[str, float]:
    """Milliseconds of one run, and its statistics."""
    module = import_module(f"{PACKAGES[system]}.{model}")
    begin = time.perf_counter()
    statistics = module.run(PARAMETERS[model, size], seed)
    return {"ms": (time.perf_counter() - begin) * 1e3, **statistics()}


def main() -> None:
    """Answer seeds until standard input ends."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("system", choices=PACKAGES)
    parser.add_argument("model", choices=MODELS)
    parser.add_argument("size", choices=SIZES)
    given = parser.parse_args()
    if (given.model, given.size) not in PARAMETERS:
        parser.error(f"{given.model} has no size {given.size}")
    measured(given.system, given.model, "small", 0)  # Imports and compiles.
    for line in sys.stdin:
        print(json.dumps(measured(given.system, given.model, given.size, int(line))), flush=True)


if __name__ == "__main__":
    main()
