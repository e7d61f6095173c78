"""One request: calls until an answer is valid, with retries and corrections, within the budget."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from minerva_assistants.llm.backends import Backend, BackendError, Completion, Prompt, Unavailable
from minerva_assistants.llm.budgets import Ledger, Prices
from minerva_assistants.llm.cache import CompletionCache
from minerva_assistants.llm.reading import MindRequest
from minerva_assistants.llm.tools import ToolServers, UsedTool
from minerva_assistants.minds.form import event_of, json_object, schema_of
from minerva_assistants.minds.mind import Account
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.vocabulary import EventType

FIRST_WAIT_SECONDS: Final = 0.5
MAX_WAIT_SECONDS: Final = 30.0
MAX_PAUSE_SECONDS: Final = 120.0
"""A server that forbids calls for longer is given up: the request would seem to hang."""


@dataclass(frozen=True, slots=True)
class CallLimits:
    """Limits of calls.

    Attributes:
        concurrent: calls at the same time.
        per_minute: calls that begin within a minute; 0: any number.
        timeout: seconds for a call.
        retries: further attempts after a call that failed.
        corrections: further attempts after an invalid answer.
        tool_calls: calls of tools before an answer.

    Raises:
        MisuseError: a limit is out of range.

    """

    concurrent: int = 8
    per_minute: int = 0
    timeout: float = 60.0
    retries: int = 3
    corrections: int = 2
    tool_calls: int = 5

    def __post_init__(self) -> None:
        least = {"concurrent": 1, "per_minute": 0, "retries": 0, "corrections": 0, "tool_calls": 0}
        for name, number in least.items():
            value = getattr(self, name)
            if value < number:
                raise MisuseError(f"llm: {name} is {value}; expected at least {number}")
        if not 0 < self.timeout < float("inf"):
            raise MisuseError(f"llm: timeout is {self.timeout}; expected seconds above 0")


@dataclass(frozen=True, slots=True)
class CallSetup:
    """What calls need besides their limits; `system` begins the system text of each prompt."""

    backend: Backend
    events: Mapping[str, EventType]
    system: str
    prices: Prices
    ledger: Ledger
    cache: CompletionCache
    log: Callable[[str], None]
    tools: ToolServers


@dataclass(frozen=True, slots=True)
class RequestResult:
    """How a request ended; `content` is the data of the answer in JSON, or the reason.

    `seconds` is measured by the clock; `simulated` is the duration of a scripted answer.
    """

    asked: MindRequest
    outcome: str
    content: str
    usage: Account
    model: str
    cached: bool
    seconds: float
    simulated: float
    tools: tuple[UsedTool, ...] = ()


class CallGate:
    """Limits how many calls run at the same time, and how many begin in a minute."""

    def __init__(self, limits: CallLimits) -> None:
        self._places = asyncio.Semaphore(limits.concurrent)
        self._interval = 60 / limits.per_minute if limits.per_minute else 0.0
        self._next = 0.0

    async def __aenter__(self) -> None:
        await self._places.acquire()
        now = time.monotonic()
        begin = max(now, self._next)
        self._next = begin + self._interval
        try:
            await asyncio.sleep(begin - now)
        except asyncio.CancelledError:
            self._places.release()
            raise

    async def __aexit__(self, *_: object) -> None:
        self._places.release()


class _Ended(Exception):
    """The request has no answer."""

    def __init__(self, outcome: str, reason: str) -> None:
        super().__init__(reason)
        self.outcome = outcome


@dataclass(slots=True)
class Answering:
    """The work on one request."""

    setup: CallSetup
    limits: CallLimits
    gate: CallGate
    asked: MindRequest
    usage: Account = field(default_factory=Account)
    model: str = ""
    cached: bool = False
    simulated: float = 0.0
    tools: list[UsedTool] = field(default_factory=list[UsedTool])

    async def result(self) -> RequestResult:
        """The result; also of a task that is cancelled, or fails in an unexpected way."""
        began = time.monotonic()
        outcome = "answered"
        try:
            content = await self._content()
        except _Ended as ended:
            outcome, content = ended.outcome, str(ended)
        except asyncio.CancelledError:
            outcome, content = "cancelled", ""
        except Exception as error:
            outcome, content = "backend", f"{type(error).__name__}: {error}"
            self.setup.log(f"llm: {content}")
        return self.ended(outcome, content, time.monotonic() - began)

    def ended(self, outcome: str, content: str, seconds: float = 0.0) -> RequestResult:
        """The result with this outcome."""
        return RequestResult(
            self.asked, outcome, content, self.usage, self.model, self.cached, seconds,
            self.simulated, tuple(self.tools),
        )  # fmt: skip

    async def _content(self) -> str:
        """The data of a valid answer. Raises _Ended."""
        request = self.asked.request
        declared = self.setup.events.get(request.answer)
        if declared is None or declared.visual:
            raise _Ended("invalid", f"the world has no event type {request.answer}")
        try:
            schema = schema_of(declared)
        except MisuseError as error:
            raise _Ended("invalid", str(error)) from None
        tools = await self.setup.tools.text()
        prompt = Prompt.of(request, self.setup.system, schema, tools)
        reason, rejected = "", 0
        while rejected <= self.limits.corrections:
            completion = await self._complete(prompt)
            wanted = json_object(completion.text) if prompt.has_tools else None
            if wanted is not None and self._may_call(wanted):
                used = await self.setup.tools.call(wanted)
                self.tools.append(used)
                prompt = prompt.after_tool(completion.text, used.shown)
                continue
            rejected += 1
            try:
                event = event_of(declared, completion.text, request.topic)
            except MisuseError as error:
                reason = str(error)
                prompt = prompt.corrected(completion.text, reason)
            else:
                return json.dumps(event.data)
        raise _Ended("invalid", reason)

    def _may_call(self, wanted: Mapping[str, Any]) -> bool:
        """Whether an answer calls a tool, and a further call is permitted."""
        return self.setup.tools.wanted(wanted) and len(self.tools) < self.limits.tool_calls

    async def _complete(self, prompt: Prompt) -> Completion:
        """A completion, from the cache or of a call. Raises _Ended."""
        backend, cache = self.setup.backend, self.setup.cache
        kept = cache.find(backend.name, prompt)
        if kept is not None:
            self.model, self.cached = kept.model, True
            return kept
        self.cached = False
        completion = await self._called(prompt)
        try:
            cache.keep(backend.name, prompt, completion)
        except OSError as error:
            self.setup.log(f"llm: cache: {error}")
        return completion

    async def _called(self, prompt: Prompt) -> Completion:
        wait, reason = FIRST_WAIT_SECONDS, ""
        for attempt in range(self.limits.retries + 1):
            if attempt:
                await asyncio.sleep(wait)
            try:
                return await self._call(prompt)
            except Unavailable as error:
                reason = str(error)
                if error.wait > MAX_PAUSE_SECONDS:
                    reason = f"{reason}; the server allows no call within {MAX_PAUSE_SECONDS:g} s"
                    break
                wait = max(error.wait, min(FIRST_WAIT_SECONDS * 2**attempt, MAX_WAIT_SECONDS))
                self.setup.log(f"llm: {reason}")
            except BackendError as error:
                self.setup.log(f"llm: {error}")
                raise _Ended("backend", str(error)) from None
        raise _Ended("backend", reason)

    async def _call(self, prompt: Prompt) -> Completion:
        """One call. Raises BackendError, and _Ended if the budget is exhausted."""
        async with self.gate:
            # Here and not before the gate, so that calls that are running count.
            exceeded = self.setup.ledger.exceeded(self.asked.request.asker)
            if exceeded:
                raise _Ended("budget", exceeded)
            self._use(Account(calls=1))
            try:
                async with asyncio.timeout(self.limits.timeout):
                    completion = await self.setup.backend.complete(prompt)
            except TimeoutError:
                raise Unavailable(f"no answer within {self.limits.timeout:g} s") from None
        self.model = completion.model
        self.simulated += completion.seconds
        cost = self.setup.prices.cost(completion)
        if lacking := self.setup.prices.lacking(completion.model):
            self.setup.log(f"llm: {lacking}")
        self._use(Account("", 0, completion.tokens_in, completion.tokens_out, cost))
        return completion

    def _use(self, usage: Account) -> None:
        self.usage = self.usage.plus(usage)
        self.setup.ledger.add(self.asked.request.asker, usage)
