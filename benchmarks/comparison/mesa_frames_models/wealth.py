"""Wealth exchange in mesa-frames: all rich people give a coin at once."""

# pyright: reportMissingImports=false, reportMissingTypeStubs=false, reportUntypedBaseClass=false

from __future__ import annotations

import numpy as np
import polars as pl
from mesa_frames import AgentSetPolars, ModelDF

from benchmarks.comparison.figures import of_wealth
from benchmarks.comparison.parameters import Wealth


class People(AgentSetPolars):
    def __init__(self, model, count):
        super().__init__(model)
        self += pl.DataFrame({
            "unique_id": pl.int_range(count, eager=True),
            "coins": pl.ones(count, dtype=pl.Int64, eager=True),
        })  # fmt: skip

    def step(self):
        rich = pl.col("coins") > 0
        count = self.agents.select(rich.sum()).item()
        to = pl.Series("unique_id", self.model.random.integers(len(self), size=count))
        received = to.value_counts(name="received").cast(pl.Int64)
        self.agents = (
            self.agents.join(received, on="unique_id", how="left")
            .with_columns(pl.col("coins") - rich.cast(pl.Int64) + pl.col("received").fill_null(0))
            .drop("received")
        )


class Town(ModelDF):
    def __init__(self, p: Wealth, seed: int):
        super().__init__(seed)
        self.people = People(self, p.people)
        self.agents += self.people

    def step(self):
        self.agents.do("step")


def run(p: Wealth, seed: int):
    """Run the model; returns the function that computes its statistics."""
    model = Town(p, seed)
    for _ in range(p.steps):
        model.step()
    return lambda: of_wealth(np.array(model.people.agents["coins"]))
