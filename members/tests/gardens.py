"""Runs of the garden of the README, with members in any language."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from minerva_bus import parse
from tests.runtime.running import World, eventually

ROOT = Path(__file__).parents[2]
GARDEN = ROOT / "members" / "garden"
SECONDS = 120

PYTHON_SNAILS = '[process.snails]\nagents = "garden:Snail"\n'
PYTHON_SUN = '[process.sun]\nservice = "each"\nevent = "eSun"\n'
PYTHON_RAIN = '[process.rain]\nservice = "each"\nevent = "eRain"\nevery = 2\n'


def command(name: str, *words: object) -> str:
    """The table of a process that ends the world if it fails."""
    quoted = json.dumps([str(word) for word in words])
    return f'[process.{name}]\ncommand = {quoted}\non_failure = "stop"\n'


def write(folder: Path, processes: str, settings: str = "") -> Path:
    """The world file of the garden with these processes; `settings` are lines of [world]."""
    shutil.copy(GARDEN / "garden.py", folder)
    text = (GARDEN / "garden.toml").read_text(encoding="utf-8")
    file = folder / "garden.toml"
    world = text[: text.index("[process.")]
    file.write_text(f"{world}{settings}\n{processes}", encoding="utf-8")
    return file


def words(file: Path) -> list[str]:
    """The command that runs a world file."""
    return [sys.executable, "-m", "minerva_bus.cli.main", "run", str(file), "--json"]


def environment(folder: Path) -> dict[str, str]:
    """The environment of that command."""
    return {**os.environ, "MINERVA_RUNTIME_DIR": str(folder)}


def run(folder: Path, processes: str) -> dict[str, Any]:
    """The summary of the garden with these processes."""
    done = subprocess.run(
        words(write(folder, processes)),
        env=environment(folder),
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stderr
    return json.loads(done.stdout)


def norm_refuses(folder: Path, guest: Sequence[str]) -> None:
    """Attach a program that makes eSun to a garden in which people may send none.

    An attached program counts as a person of its name, whatever language it is in.
    """
    norm = '[norm.dark]\napplies = "people:lamp"\non = "eSun"\nwhen = "event.heat > 0.1"\n'
    file = write(folder, PYTHON_SNAILS + norm, "rate = 50")
    text = file.read_text(encoding="utf-8").replace("frames = 60", "frames = 100000")
    file.write_text(text, encoding="utf-8")
    with World(file) as world, world.client() as asked:
        address = {"MINERVA_WORLD": "garden", "MINERVA_CONNECT": world.endpoint()}
        own = {**os.environ, **address, "MINERVA_NAME": "lamp"}
        with subprocess.Popen(guest, env=own) as lamp:
            try:
                world.says("dark is broken by lamp", "eSun<heat=0.2>", ": refused")
                refused = asked.ask("scene")["frame"]
                # It sends one in each frame.
                eventually(lambda: asked.ask("scene")["frame"] > refused + 1, "no other frame")
                string = asked.ask("scene")["scene"]
            finally:
                lamp.kill()
    assert parse(string) == parse("ASnail#anna<water=3, births=0> · ASnail#bert<water=4, births=0>")


def readme_digest() -> str:
    """The digest of the README's program, which runs in one Python process."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", readme, re.S)
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(next(block for block in blocks if "Snail" in block), "README.md", "exec"), names)
    return names["done"].digest
