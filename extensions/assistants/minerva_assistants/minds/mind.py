"""The agent that represents a slow participant outside of the world, such as a language model.

An agent sends `eAsk` to a mind, which keeps the request in a figure until it has an answer, and
shows it. A service is a device whose geometric system is one of calls, which α of `PRequests`
begins. The result is an event `eReply` of the service, which is a free-running generator. So
requests, answers and their costs are part of the string and of the record, and no frame waits.

The mind sends exactly one event for each request: the answer, or `eNoAnswer`. It decides by frames
and received events only, so every repetition of the run decides alike.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, cast

import numpy as np

from minerva_assistants.minds.symbols import PAccounts, PRequests, TMind, eNoAnswer, eRemind
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY, FigureNode, Scene
from minerva_bus.grammar.types import Reals
from minerva_bus.world.agent import Agent
from minerva_bus.world.class_declaration import on, view
from minerva_bus.world.context import Context


@dataclass(frozen=True, slots=True)
class OpenRequest:
    """A request without an answer so far; the fields are the parameters of `PRequests`."""

    number: int
    asker: str
    prompt: str
    system: str
    answer: str
    topic: str
    frame: int
    deadline: int

    @staticmethod
    def all_of(lists: Mapping[str, Sequence[Any]]) -> list[OpenRequest]:
        """The requests of a figure `PRequests`, by its parameters."""
        rows = zip(*lists.values(), strict=True)
        return [OpenRequest(**dict(zip(lists, row, strict=True))) for row in rows]


@dataclass(frozen=True, slots=True)
class Account:
    """What requests of an agent have cost: a row of `PAccounts`."""

    agent: str = ""
    calls: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    cost: float = 0.0

    def plus(self, usage: Event | Account) -> Account:
        """The account after further calls: an `eReply`, or another account."""
        return replace(
            self,
            calls=self.calls + usage.calls,
            tokens_in=self.tokens_in + usage.tokens_in,
            tokens_out=self.tokens_out + usage.tokens_out,
            cost=self.cost + usage.cost,
        )


REQUEST_NAMES = tuple([each.name for each in fields(OpenRequest)])
NOTHING = np.zeros((0, 4))
"""The usage of no agents."""


class Mind(Agent, symbol="AMind"):
    """Represents a backend; `requests`: ε or a figure of those open, `asked`: the number of all."""

    requests: Scene = EMPTY
    agents: tuple[str, ...] = ()
    used: Reals = NOTHING
    asked: int = 0
    answered: int = 0
    failed: int = 0
    reminded: bool = False

    @on("eAsk")
    def ask(self, question: Event, moment: Context) -> None:
        """Keep a request, and show it from the next frame on."""
        if not question.sender:
            return  # Only an agent can receive the answer.
        self.asked += 1
        frames = math.ceil(question.within / moment.dt)
        request = OpenRequest(
            number=self.asked,
            asker=question.sender,
            prompt=question.prompt,
            system=question.system,
            answer=question.answer,
            topic=question.topic,
            frame=moment.number,
            deadline=moment.number + frames,
        )
        lists = self._lists()
        self.requests = PRequests(
            **{name: (*lists[name], value) for name, value in asdict(request).items()}
        )
        self._remind(moment)

    @on("eReply")
    def reply(self, reply: Event, moment: Context) -> None:
        """Send the answer of an open request; of a late reply, only the costs count."""
        # An agent cannot answer in the name of the service.
        if reply.sender:
            return
        self._book(reply)
        request = self._close(reply.number)
        if request is None:
            return
        if reply.outcome == "answered":
            self.answered += 1
            moment.emit(_answer(request, reply.content))
        elif reply.outcome != "cancelled":
            self._fail(request, reply.outcome, reply.content, moment)

    @on("eRemind")
    def check(self, reminder: Event, moment: Context) -> None:
        """End the requests whose deadline has passed."""
        if reminder.sender != self.id:
            return
        lists = self._lists()
        for number, deadline in zip(lists["number"], lists["deadline"], strict=True):
            if deadline > moment.number:
                continue
            request = self._close(number)
            if request is not None:
                waited = (moment.number - request.frame) * moment.dt
                self._fail(request, "time", f"no answer within {waited:g} s", moment)
        self.reminded = False
        if self.requests:
            self._remind(moment)

    @view("eThink")
    def show(self, event: Event) -> Scene:
        """Its id with the open requests, and what each agent has used."""
        return TMind(self.id)(self.requests + PAccounts(self.agents, self.used))

    def _remind(self, moment: Context) -> None:
        if not self.reminded:
            self.reminded = True
            moment.emit(eRemind(receivers=[self.id]))

    def _fail(self, request: OpenRequest, reason: str, detail: str, moment: Context) -> None:
        self.failed += 1
        moment.emit(eNoAnswer(reason, detail, request.topic, receivers=[request.asker]))

    def _close(self, number: int) -> OpenRequest | None:
        """Remove an open request and return it; None if there is none with this number."""
        lists = self._lists()
        if number not in lists["number"]:
            return None
        at = lists["number"].index(number)
        left = {name: column[:at] + column[at + 1 :] for name, column in lists.items()}
        self.requests = PRequests(**left) if left["number"] else EMPTY
        return OpenRequest(**{name: column[at] for name, column in lists.items()})

    def _lists(self) -> dict[str, tuple[Any, ...]]:
        """The open requests as lists by name."""
        for node in self.requests:
            if isinstance(node, FigureNode):
                return cast("dict[str, tuple[Any, ...]]", node.parameters)
        return dict.fromkeys(REQUEST_NAMES, ())

    def _book(self, reply: Event) -> None:
        usage = [reply.calls, reply.tokens_in, reply.tokens_out, reply.cost]
        if not reply.calls:
            return
        if reply.agent not in self.agents:
            self.agents += (reply.agent,)
            self.used = np.vstack((self.used, np.zeros(len(usage))))
        self.writable("used")[self.agents.index(reply.agent)] += usage


def _answer(request: OpenRequest, content: str) -> Event:
    """The answer as an event of the requested type; the host checks it against the vocabulary."""
    data = cast("dict[str, Any]", json.loads(content))
    values = tuple([_plain(value) for value in data.values()])
    return Event(request.answer, tuple(data), values, receivers=(request.asker,))


def _plain(value: Any) -> Any:
    """A JSON value as a value of an event: a list is a tuple."""
    return tuple(map(_plain, cast("list[Any]", value))) if isinstance(value, list) else value
