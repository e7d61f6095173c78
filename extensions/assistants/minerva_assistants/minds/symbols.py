"""Event types of requests and answers, and the figures by which a mind shows its requests."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from minerva_bus.grammar.fields import Default
from minerva_bus.grammar.types import Range, Reals, Seconds
from minerva_bus.grammar.vocabulary import EventType, Primitive, Transformation

# ruff: noqa: N816 - event types begin with e

Reason = Literal["time", "budget", "backend", "invalid"]
"""Why a request has no answer: deadline, budget, failure of the backend, or invalid answers."""

eAsk = EventType(
    "eAsk",
    prompt=str,
    system=Default(str, ""),
    answer=Default(str, "eAnswer"),
    topic=Default(str, ""),
    within=Default(Annotated[Seconds, Range(least=0)], 60.0),
)
"""A request to a mind.

`answer` is the event type of the answer. `topic` is repeated in the answer, if its type declares a
`topic`. `within` is the deadline in simulated seconds.
"""

eAnswer = EventType("eAnswer", text=str, topic=Default(str, ""))
"""An answer in free text."""

eNoAnswer = EventType("eNoAnswer", reason=Reason, detail=Default(str, ""), topic=Default(str, ""))
"""The end of a request that has no answer."""

_usage: dict[str, Any] = {
    "calls": Default(int, 0),
    "tokens_in": Default(int, 0),
    "tokens_out": Default(int, 0),
    "cost": Default(float, 0.0),
}

eReply = EventType(
    "eReply",
    number=int,
    agent=str,
    outcome=Literal["answered", "cancelled", "budget", "backend", "invalid"],
    content=Default(str, ""),
    model=Default(str, ""),
    cached=Default(bool, False),
    seconds=Default(Seconds, 0.0),
    **_usage,
    tools=Default(str, ""),
)
"""What a service reports to a mind about a request of an agent.

`content` is the data of the answer as a JSON object, or the reason of a failure. `seconds` is the
duration by the clock, or in simulated time if frames wait for the service; `cost` is in the
currency of the price table. `tools` are the calls of tools before the answer, with arguments,
results and times, as a JSON list; empty without any.
"""

eRemind = EventType("eRemind")
"""A mind with open requests sends this to itself in each frame, to check deadlines."""

eThink = EventType("eThink", visual=True)

_Numbers = tuple[int, ...]
_Texts = tuple[str, ...]

PRequests = Primitive(
    "PRequests",
    number=_Numbers,
    asker=_Texts,
    prompt=_Texts,
    system=_Texts,
    answer=_Texts,
    topic=_Texts,
    frame=_Numbers,
    deadline=_Numbers,
)
"""The open requests, oldest first; each list has a value for each request.

A request was received in `frame`, and has an answer until the frame `deadline`. Lists, because a
figure for each of a hundred requests takes ten times as long to check and to send.
"""

PAccounts = Primitive("PAccounts", agents=_Texts, used=Reals)
"""What the requests of agents have cost so far.

`used` has a row for each agent: calls, tokens in, tokens out and cost. A matrix, because there may
be hundreds of agents, and a row for each in each answer.
"""

TMind = Transformation("TMind", id=str)
