"""Wealth exchange in AMBER: all rich people give a coin at once."""

# pyright: reportMissingImports=false, reportMissingTypeStubs=false, reportUntypedBaseClass=false
# pyright: reportOperatorIssue=false, reportFunctionMemberAccess=false

from __future__ import annotations

import ambr

from benchmarks.comparison.figures import of_wealth
from benchmarks.comparison.parameters import Wealth


class Town(ambr.Model):
    def setup(self):
        self.add_agents(self.p.people, coins=1)

    def step_vectorized(self):
        rich = self.agents.where(self.agents.coins > 0)
        rich.coins -= 1
        to = self.rng.choice(self.agents.ids.to_numpy(), size=len(rich))
        self.agents.at[to].scatter_add(coins=1)


def run(p: Wealth, seed: int):
    """Run the model; returns the function that computes its statistics."""
    model = Town({"people": p.people, "steps": p.steps, "seed": seed, "show_progress": False})
    model.cpu(mode="vectorized").run()
    return lambda: of_wealth(model.agents.coins.to_numpy())
