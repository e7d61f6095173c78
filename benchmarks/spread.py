"""Compare the behaviour of models with their peers: statistics after some steps and seeds."""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from pathlib import Path
from typing import Final

from benchmarks.forked import answered

STEPS: Final[dict[str, tuple[int, ...]]] = {
    "wealth": (1, 10, 100),
    "wolf_sheep": (1, 5, 10, 20, 40, 80, 160),
}
AGENTS: Final = {"wealth": 10_000, "wolf_sheep": 3_000}
PEERS: Final = {"wealth": ("mesaframes", "mesa"), "wolf_sheep": ("mesa",)}

Curves = dict[int, dict[str, list[float]]]
"""By step and name of a statistic: its value for each seed."""


def compare(arguments: argparse.Namespace) -> None:
    """Print the mean and deviation of each statistic for all systems."""
    for model in arguments.model:
        if model not in STEPS:
            print(f"{model}: no peer's figures to set beside", file=sys.stderr)
            continue
        agents = arguments.agents[0] or AGENTS[model]
        curves_by_system: dict[str, Curves] = {"minerva": ours(model, agents, arguments.seeds)}
        for peer in PEERS[model]:
            curves = theirs(peer, model, agents, arguments.seeds, arguments.peers)
            if isinstance(curves, str):
                print(f"{peer}: {model} left out: {curves}", file=sys.stderr)
            else:
                curves_by_system[peer] = curves
        shown(model, agents, curves_by_system, as_json=arguments.json)


def ours(model: str, agents: int, seeds: int) -> Curves:
    """Statistics of the Minerva Bus model."""
    from benchmarks.populations import Task, final

    curves: Curves = {}
    for seed in range(1, seeds + 1):
        for step, figures in final(Task(model, agents, 0, 0, seed), STEPS[model]).items():
            for name, value in figures.items():
                curves.setdefault(step, {}).setdefault(name, []).append(value)
    return curves


def theirs(peer: str, model: str, agents: int, seeds: int, folder: Path) -> Curves | str:
    """Statistics of a peer, or the reason why there are none."""
    python = (folder / "venvs" / peer / "bin" / "python").absolute()
    if not python.is_file():
        return f"{python} is not there"
    script = Path(__file__).with_name("peer_statistics.py")
    words = [python, script, peer, model, str(agents), str(seeds), *map(str, STEPS[model])]
    plain = answered(words, folder)
    if isinstance(plain, str):
        return plain
    return {int(step): figures for step, figures in plain.items()}


def shown(model: str, agents: int, curves_by_system: dict[str, Curves], *, as_json: bool) -> None:
    """Print a line for each step and statistic."""
    if not as_json:
        titles = " ".join(f"{system:>22}" for system in curves_by_system)
        print(f"{model}, {agents:,} agents\n{'step':>5} {'figure':9} {titles}")
    for step, figures in curves_by_system["minerva"].items():
        for name in figures:
            values = {system: curves[step][name] for system, curves in curves_by_system.items()}
            if as_json:
                print(json.dumps({"model": model, "step": step, "figure": name, **values}))
            else:
                cells = " ".join(map(_cell, values.values()))
                print(f"{step:5} {name:9} {cells}")


def _cell(values: list[float]) -> str:
    spread = statistics.stdev(values) if len(values) > 1 else 0.0
    return f"{statistics.fmean(values):12.4g} ±{spread:8.2g}"
