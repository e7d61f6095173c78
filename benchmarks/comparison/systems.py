"""The systems that run here: each answers a list of seeds with one result per seed."""

from __future__ import annotations

import io
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tokenize
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Final, Protocol

from benchmarks.comparison.worker import PACKAGES

TIMEOUT: Final = 3600.0
MASON_NAMES: Final = {
    "wolf_sheep": ("WolfSheep", "Wsg"),
    "flocking": ("Flocking", "Flocking"),
    "schelling": ("Schelling", "Schelling"),
}
"""The folder of each model beside MASON's jar, and its main class."""

MASON_STEPS: Final = {"wolf_sheep": 100, "flocking": 100, "schelling": 20}


class Unavailable(Exception):
    """A system cannot run a model; the text is the reason."""


class System(Protocol):
    """One model and size of a system that runs here."""

    def run(self, seeds: Sequence[int]) -> list[dict[str, float]]:
        """Milliseconds and statistics of a run with each seed. Raises Unavailable."""
        ...

    def lines(self) -> int:
        """Lines of code of the model, without comments and blank lines."""
        ...

    def close(self) -> None:
        """End its processes."""
        ...


class PythonSystem:
    """A model in a Python process of its own, which lives until `close`.

    `python` is an interpreter that has the system; None is this one.
    """

    def __init__(self, system: str, model: str, size: str, python: Path | None = None) -> None:
        package = PACKAGES[system]
        if find_spec(f"{package}.{model}") is None:
            raise Unavailable("it has no such model")
        missing = python is None and find_spec(system.replace("-", "_")) is None
        if system != "minerva" and missing:
            raise Unavailable(f"it is not installed: pip install {system}")
        self._source = Path(*package.split("."), f"{model}.py")
        words = ["-m", "benchmarks.comparison.worker", system, model, size]
        self._process = subprocess.Popen(
            [python or sys.executable, *words],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def run(self, seeds: Sequence[int]) -> list[dict[str, float]]:
        """See `System`."""
        return [self._answer(seed) for seed in seeds]

    def _answer(self, seed: int) -> dict[str, float]:
        asked, answers = self._process.stdin, self._process.stdout
        assert asked is not None
        assert answers is not None
        try:
            asked.write(f"{seed}\n")
            asked.flush()
        except BrokenPipeError:
            raise Unavailable("its process has failed") from None
        line = answers.readline()
        if not line:
            raise Unavailable("its process has failed")
        return json.loads(line)

    def lines(self) -> int:
        """See `System`."""
        return python_lines(self._source.read_text())

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()


class Mason:
    """MASON's models, from a clone of the comparison's repository that contains its jar."""

    def __init__(self, model: str, size: str, jar: Path | None) -> None:
        if model not in MASON_NAMES:
            raise Unavailable("it has no such model")
        if jar is None or not jar.is_file():
            raise Unavailable("give --mason the path of its jar in a clone of the comparison")
        if shutil.which("javac") is None:
            raise Unavailable("javac is not installed")
        folder, main = MASON_NAMES[model]
        self._sources = sorted((jar.parent / folder / "Mason").glob(f"*_{size}.java"))
        if not self._sources:
            raise Unavailable(f"{jar.parent / folder / 'Mason'} has no sources")
        self._steps = MASON_STEPS[model]
        self._folder = tempfile.TemporaryDirectory()
        self._class = f"{main}_{size}"
        self._path = f"{self._folder.name}:{jar}"
        words = ["javac", "-nowarn", "-cp", self._path, "-d", self._folder.name]
        done = subprocess.run([*words, *self._sources], capture_output=True, text=True, check=False)
        if done.returncode:
            raise Unavailable(f"javac failed: {done.stderr[:200]}")

    def run(self, seeds: Sequence[int]) -> list[dict[str, float]]:
        """See `System`; a first run, in which Java compiles, does not count."""
        words = ["java", "-cp", self._path, self._class, "-quiet", "-for", self._steps]
        words += ["-seed", seeds[0], "-repeat", len(seeds) + 1]
        done = subprocess.run(
            [*map(str, words)], capture_output=True, text=True, check=False, timeout=TIMEOUT
        )
        times = re.findall(r"JobTime: (\d+)", done.stdout)
        if len(times) != len(seeds) + 1:
            raise Unavailable(f"java failed: {done.stderr[:200]}")
        return [{"ms": int(nanoseconds) / 1e6} for nanoseconds in times[1:]]

    def lines(self) -> int:
        """See `System`."""
        return sum(java_lines(source.read_text()) for source in self._sources)

    def close(self) -> None:
        """Remove the compiled classes."""
        self._folder.cleanup()


def system(name: str, model: str, size: str, paths: Mapping[str, Path | None]) -> System:
    """A system with one model; `paths` has MASON's jar and interpreters. Raises Unavailable."""
    path = paths.get(name)
    return Mason(model, size, path) if name == "mason" else PythonSystem(name, model, size, path)


def python_lines(source: str) -> int:
    """Lines with code, without comments, blank lines and documentation strings."""
    code: set[int] = set()
    begins = True
    passive = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT):
            begins = True
        if token.type in passive or (begins and token.type == tokenize.STRING):
            continue
        begins = False
        code.update(range(token.start[0], token.end[0] + 1) if token.string.strip() else ())
    return len(code)


def java_lines(source: str) -> int:
    """Lines with code, without comments and blank lines."""
    source = re.sub(r"/\*.*?\*/", "", source, flags=re.DOTALL)
    lines = [line.split("//")[0].strip() for line in source.splitlines()]
    return len([line for line in lines if line])
