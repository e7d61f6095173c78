"""Fuzz the readers of external input.

    python -m checks.fuzz --seconds 60 [--target NAME ...] [--seed 1] [--keep FOLDER]

The time is divided among the targets (tests/fuzz/targets.py). Each runs in a separate process, in
which Atheris mutates the inputs of tests/fuzz/corpus guided by branch coverage. A target fails if a
reader raises an undeclared error, takes longer than 10 s for one input, or uses more than 2 GB. The
folder keeps the failing input; add it to the corpus when the reader is fixed.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import sys
import tempfile
import time
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from typing import NoReturn

try:
    import atheris
except ImportError:
    raise SystemExit("fuzzing takes Atheris: pip install atheris (Linux)") from None

OURS = ["minerva_bus", "minerva_services", "minerva_agents", "pynmea2"]
with redirect_stderr(StringIO()), atheris.instrument_imports(include=OURS):  # Hide its progress.
    from tests.fuzz.targets import TARGETS, Target

CORPUS = Path(__file__).resolve().parent.parent / "tests" / "fuzz" / "corpus"
MEMORY = 2 << 30
SECONDS_OF_ONE = 10
ROUND = 60.0
"""Seconds per process: Atheris leaks memory with numpy's comparisons."""


def inside(target: Target, words: list[str], log: Path) -> NoReturn:
    """Fuzz one target in this child process, which Atheris ends."""
    with log.open("w") as output:
        for stream in (1, 2):
            os.dup2(output.fileno(), stream)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    atheris.Setup([sys.argv[0], *words, f"-max_len={target.longest}"], target)
    atheris.Fuzz()
    os._exit(0)


def fuzz(name: str, seconds: float, seed: int, keep: Path) -> bool:
    """Fuzz one target, with a new process for each round; returns whether it passed."""
    log, tried, peak, status = keep / f"{name}.log", 0, 0, 0
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as grown:
        while status == 0 and (rest := seconds - (time.monotonic() - began)) > 0:
            status = a_round(name, min(rest, ROUND), seed, keep, grown)
            said = log.read_text(errors="replace")
            tried += _stat(said, "number_of_executed_units")
            peak = max(peak, _stat(said, "peak_rss_mb"))
            seed += 1
    how = "nothing found" if status == 0 else f"FOUND, see {log}\n{_finding(said)}"
    took = time.monotonic() - began
    print(f"{name:10} {tried:>9} inputs in {took:5.0f} s, {peak} MB: {how}", flush=True)
    return status == 0


def a_round(name: str, seconds: float, seed: int, keep: Path, grown: str) -> int:
    """Continue from the inputs in `grown` of earlier rounds; returns 0 if the target passed."""
    words = [
        grown, str(CORPUS / name), f"-max_total_time={max(1, round(seconds))}",
        f"-seed={seed}", f"-timeout={SECONDS_OF_ONE}", f"-artifact_prefix={keep}/{name}-",
        f"-rss_limit_mb={MEMORY >> 20}", "-print_final_stats=1",
    ]  # fmt: skip
    child = os.fork()
    if child == 0:
        inside(TARGETS[name], words, keep / f"{name}.log")
    return os.waitpid(child, 0)[1]


def _finding(text: str) -> str:
    """The error report in Atheris's output."""
    crash = re.search(r"=== Uncaught.*?\n\n|^==\d+== ERROR.*?$|ALARM.*?$", text, re.S | re.M)
    return crash[0] if crash else text[-400:]


def _stat(text: str, name: str) -> int:
    match = re.search(rf"stat::{name}:\s*(\d+)", text)
    return int(match[1]) if match else 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="in all")
    parser.add_argument(
        "--target", action="append", choices=sorted(TARGETS), help="all, if none is named"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "minerva-fuzz")
    given = parser.parse_args()
    keep: Path = given.keep.absolute()
    keep.mkdir(parents=True, exist_ok=True)
    chosen = given.target or sorted(TARGETS)
    results = [fuzz(name, given.seconds / len(chosen), given.seed, keep) for name in chosen]
    raise SystemExit(not all(results))


if __name__ == "__main__":
    main()
