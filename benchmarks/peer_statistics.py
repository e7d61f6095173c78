"""Statistics of a peer after some steps; runs in the peer's Python, in its script's folder.

venvs/mesa/bin/python peer_statistics.py mesa wealth 10000 5 1 10 100
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path.cwd()))


def inequality(wealth: Any) -> dict[str, float]:
    """The statistics of benchmarks/models/wealth.py."""
    ranked = np.sort(np.asarray(wealth))
    count = len(ranked)
    rank = np.arange(1, count + 1)
    gini = 2 * float((rank * ranked).sum()) / (count * float(ranked.sum())) - (count + 1) / count
    rich = ranked[ranked >= 2]
    return {
        "mean": float(ranked.mean()),
        "gini": gini,
        "poor": float((ranked == 0).mean()),
        "decay": float(-np.log1p(-1 / (rich.mean() - 1))) if (rich > 2).any() else 0.0,
    }


def mesa_wealth(agents: int, seed: int) -> tuple[Any, Any]:
    """Functions for a step of Mesa's model and for its statistics."""
    import bench_mesa

    model, step, _ = bench_mesa.build("wealth", agents // 100, seed, True)
    return step, lambda: inequality([agent.wealth for agent in model.everybody])


def mesa_wolf_sheep(agents: int, seed: int) -> tuple[Any, Any]:
    """Functions for a step of Mesa's model and for its statistics."""
    import bench_mesa
    from mesa.examples.advanced.wolf_sheep.agents import Sheep, Wolf

    model, step, _ = bench_mesa.build("wolfsheep", agents // 150, seed, True)
    kinds = {"sheep": Sheep, "wolves": Wolf}
    return step, lambda: {name: len(model.agents_by_type[kind]) for name, kind in kinds.items()}


def frames_wealth(agents: int, seed: int) -> tuple[Any, Any]:
    """Functions for a step and the statistics of the mesa-frames model, in its native style."""
    import bench_mesaframes
    from mesa_frames import ModelDF

    model = ModelDF()
    natives = bench_mesaframes.Native(agents, model)
    model.agents += natives
    held = next(iter(model.agents._agentsets))
    return lambda: model.agents.do("step"), lambda: inequality(held._agents["wealth"].to_numpy())


MODELS = {
    ("mesa", "wealth"): mesa_wealth,
    ("mesa", "wolf_sheep"): mesa_wolf_sheep,
    ("mesaframes", "wealth"): frames_wealth,
}


def main() -> None:
    """Print the statistics of all seeds by step."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("peer", choices=sorted({peer for peer, _ in MODELS}))
    parser.add_argument("model", choices=sorted({model for _, model in MODELS}))
    parser.add_argument("agents", type=int)
    parser.add_argument("seeds", type=int, help="runs, with the seeds 1, 2, ...")
    parser.add_argument("steps", type=int, nargs="+", help="ascending; statistics after each")
    given = parser.parse_args()
    if (given.peer, given.model) not in MODELS:
        parser.error(f"{given.peer} has no model {given.model}")
    results: dict[int, dict[str, list[float]]] = {}
    for seed in range(1, given.seeds + 1):
        step, figures = MODELS[given.peer, given.model](given.agents, seed)
        done = 0
        for wanted in given.steps:
            while done < wanted:
                step()
                done += 1
            for name, value in figures().items():
                results.setdefault(wanted, {}).setdefault(name, []).append(value)
    print(json.dumps(results))


if __name__ == "__main__":
    main()
