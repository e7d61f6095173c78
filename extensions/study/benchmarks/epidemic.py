"""The SIR model of examples/sir in both systems, for batches of runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "sir"))

import sir_mesa


class Epidemic(sir_mesa.Epidemic):
    """Mesa's model, with its data under the name that `batch_run` expects."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.datacollector = self.curves


def mesa_batch(runs: int, frames: int, processes: int) -> int:
    """Run Mesa's `batch_run`; returns the number of rows."""
    from mesa.batchrunner import batch_run

    rows: list[Any] = batch_run(
        Epidemic, {"seed": range(runs)}, number_processes=processes, max_steps=frames - 1,
        data_collection_period=1, display_progress=False,
    )  # fmt: skip
    return len(rows)


def our_batch(runs: int, frames: int, processes: int) -> int:
    """Run `sweep`; returns the number of rows."""
    import sir

    from minerva_study import sweep

    table = sweep(
        sir.world, seeds=runs, frames=frames, collect=sir.curves, workers=processes, quiet=True
    )
    return len(table)
