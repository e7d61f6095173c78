"""Prices, budgets, and what has been used of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Final, cast

from minerva_assistants.llm.backends import Completion
from minerva_assistants.minds.mind import Account
from minerva_bus.errors import MisuseError, nearest

PER: Final = 1_000_000
"""Prices are per this number of tokens, as providers list them."""


class Prices:
    """Price of a completion by model: `{ "model" = [in, out] }` per million tokens."""

    def __init__(self, table: Mapping[str, Any] | None) -> None:
        self._prices: dict[str, tuple[float, float]] = {}
        for model, pair in (table or {}).items():
            try:
                price_in, price_out = map(float, pair)
            except (TypeError, ValueError):
                price_in = price_out = -1.0
            if not (0 <= price_in < float("inf") and 0 <= price_out < float("inf")):
                raise MisuseError(
                    f"llm: prices.{model} must be the prices of a million tokens in and out,"
                    f" such as [0.15, 0.6], not {pair!r:.60}"
                )
            self._prices[model] = price_in, price_out

    def lacking(self, model: str) -> str:
        """Why the completions of a model cost nothing although there are prices, or ""."""
        if not self._prices or model in self._prices:
            return ""
        near = nearest(model, [*self._prices], f"it has {', '.join(self._prices)}")
        return f"prices has no model {model!r}{near}; its completions cost nothing"

    def cost(self, completion: Completion) -> float:
        """The cost of a completion; 0 for a model without a price."""
        price_in, price_out = self._prices.get(completion.model, (0.0, 0.0))
        return (completion.tokens_in * price_in + completion.tokens_out * price_out) / PER


@dataclass(frozen=True, slots=True)
class Budget:
    """What may be used at most; None: any amount. `cost` is in the currency of the prices."""

    calls: int | None = None
    tokens: int | None = None
    cost: float | None = None

    @staticmethod
    def of(option: str, table: Mapping[str, Any] | None) -> Budget:
        """A budget from an option. Raises MisuseError."""
        known = [field.name for field in fields(Budget)]
        for name, value in (table or {}).items():
            if name not in known:
                raise MisuseError(f"llm: {option} has no {name!r}{nearest(name, known)}")
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not 0 <= cast("float", value) < float("inf"):
                raise MisuseError(f"llm: {option}.{name} is {value!r:.60}; expected a number")
        return Budget(**(table or {}))

    def exceeded(self, used: Account) -> str:
        """The exhausted part of the budget, or the empty text."""
        amounts = {
            "calls": (self.calls, used.calls),
            "tokens": (self.tokens, used.tokens_in + used.tokens_out),
            "cost": (self.cost, used.cost),
        }
        for name, (most, amount) in amounts.items():
            if most is not None and amount >= most:
                return f"{amount:g} of {most:g} {name}"
        return ""


class Ledger:
    """What has been used by the world and by each agent, with their budgets."""

    def __init__(self, world: Budget, agent: Budget) -> None:
        self._world, self._agent = world, agent
        self.total = Account()
        self._accounts: dict[str, Account] = {}

    def begin(self, accounts: Mapping[str, Account]) -> None:
        """Continue from what a former process of the service has used."""
        self._accounts = dict(accounts)
        for account in accounts.values():
            self.total = self.total.plus(account)

    def exceeded(self, agent: str) -> str:
        """Why a further call for an agent is not permitted, or the empty text."""
        world = self._world.exceeded(self.total)
        if world:
            return f"the world has used {world}"
        own = self._agent.exceeded(self._accounts.get(agent, Account(agent)))
        return f"#{agent} has used {own}" if own else ""

    def add(self, agent: str, usage: Account) -> None:
        """Add the usage of a call."""
        self.total = self.total.plus(usage)
        self._accounts[agent] = self._accounts.get(agent, Account(agent)).plus(usage)
