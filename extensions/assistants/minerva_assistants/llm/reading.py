"""Open requests in a view of minds."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

from minerva_assistants.minds.mind import Account, OpenRequest
from minerva_bus.grammar.types import Reals
from minerva_bus.semantics.geometry import Geometry

RequestKey: TypeAlias = tuple[str, int]
"""The id of a mind, and the number of one of its requests."""


@dataclass(frozen=True, slots=True)
class MindRequest:
    """An open request with the mind that keeps it."""

    mind: str
    request: OpenRequest

    @property
    def key(self) -> RequestKey:
        """Identifies the request in the world."""
        return self.mind, self.request.number


class OpenRequests(Geometry):
    """A geometric system of calls: α of `PRequests` are open requests of the enclosing `TMind`."""

    def __init__(self) -> None:
        self.requests: dict[RequestKey, MindRequest] = {}
        self._accounts: list[tuple[tuple[str, ...], Reals]] = []
        self._mind = ""

    @contextmanager
    def TMind(self, id: str) -> Generator[None]:
        """β and δ: the mind of the requests within."""
        self._mind = id
        yield
        self._mind = ""

    def PRequests(self, **lists: tuple[Any, ...]) -> None:
        """α: the open requests of a mind."""
        for opened in OpenRequest.all_of(lists):
            request = MindRequest(self._mind, opened)
            self.requests[request.key] = request

    def PAccounts(self, agents: tuple[str, ...], used: Reals) -> None:
        """α: what agents have used."""
        self._accounts.append((agents, used))

    def accounts(self) -> dict[str, Account]:
        """What agents have used, added over all minds."""
        accounts: dict[str, Account] = {}
        for agents, used in self._accounts:
            for agent, (calls, tokens_in, tokens_out, cost) in zip(
                agents, used.tolist(), strict=True
            ):
                usage = Account(agent, int(calls), int(tokens_in), int(tokens_out), cost)
                accounts[agent] = accounts.get(agent, Account(agent)).plus(usage)
        return accounts
