"""The service `llm`: requests in views of minds become calls, and their results events."""

from __future__ import annotations

import json
import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from queue import Empty
from typing import Any, ClassVar, Final, cast

from minerva_assistants.llm.answering import CallLimits, CallSetup, RequestResult
from minerva_assistants.llm.backends import Backend
from minerva_assistants.llm.budgets import Budget, Ledger, Prices
from minerva_assistants.llm.cache import CompletionCache
from minerva_assistants.llm.call_runner import CallRunner
from minerva_assistants.llm.http import HttpBackend
from minerva_assistants.llm.local import CommandBackend, FunctionBackend
from minerva_assistants.llm.reading import MindRequest, OpenRequests, RequestKey
from minerva_assistants.llm.script import ScriptBackend
from minerva_assistants.llm.tools import ToolServers
from minerva_assistants.minds import eReply, eThink
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.launch.specs import load
from minerva_bus.semantics.geometry import interpret
from minerva_bus.world.services import Device, Emit, Generator, Tick, View, WorldInfo
from minerva_services.bridging.bridge import log
from minerva_services.event_factory import event_type
from minerva_services.options import read_password, require

POLL_SECONDS: Final = 0.2
RESEND_SECONDS: Final = 5.0
"""A reply counts as lost if its request is still open after this time."""

MAX_LOGGED: Final = 20
"""Number of different problems that are logged."""

SHOWN_AFTER: Final = 2
"""Frames from a request to the tick in which a coupled device can answer it."""


class Llm(Generator, Device, events=("eReply",), draws=("eThink",), when="freely, each frame"):
    """Answers requests to minds by a language model, a program, a function or a script.

    Args:
        backend: the base URL of an OpenAI-compatible server; a script, `FILE.toml`; a Python
          function or a script's rules, `module:name`; or a program with its arguments, as a list.
        model: the model's name; by default the first one that the server lists.
        wait: whether frames wait for answers, for studies.
        system: system text of all requests.
        key_env: environment variable with the API key.
        key_file: file with the API key.
        parameters: further members of each call, such as `{ temperature = 0 }`.
        cache: folder for completions; an equal prompt is completed once.
        concurrent: calls at the same time.
        per_minute: calls that begin within a minute; 0: any number.
        timeout: seconds for a call.
        retries: further attempts after a call that failed.
        corrections: further attempts after an invalid answer, which name the reason.
        prices: prices of a million tokens in and out by model, `{ "NAME" = [0.15, 0.6] }`.
        budget: what the world may use: `{ calls = 1000, tokens = 100_000, cost = 5.0 }`.
        agent_budget: what each agent may use, likewise.
        tools: MCP servers by name, each `{ command = [...], allow = [...] }` or with a `url`.
        tool_calls: calls of tools before an answer.
        stream: whether a server sends its answers in pieces.
        first_token: seconds until the first piece of a streamed answer; 0: any time.

    """

    source_option: ClassVar[str] = "backend"

    def __init__(
        self,
        backend: Any,
        model: str = "",
        wait: bool = False,
        system: str = "",
        key_env: str = "",
        key_file: str = "",
        parameters: Mapping[str, Any] | None = None,
        cache: str = "",
        concurrent: int = 8,
        per_minute: int = 0,
        timeout: float = 60.0,
        retries: int = 3,
        corrections: int = 2,
        prices: Mapping[str, Any] | None = None,
        budget: Mapping[str, Any] | None = None,
        agent_budget: Mapping[str, Any] | None = None,
        tools: Mapping[str, Any] | None = None,
        tool_calls: int = 5,
        stream: bool = False,
        first_token: float = 0.0,
    ) -> None:
        self._read_key = _key_reader(key_env, key_file)
        if first_token and not (stream and 0 < first_token < float("inf")):
            raise MisuseError(f"llm: first_token is {first_token}; expected seconds, with stream")
        server = partial(
            HttpBackend,
            model=model,
            read_key=self._read_key,
            parameters=parameters or {},
            stream=stream,
            first_token=first_token,
        )
        chosen = _backend(backend, server)
        self._limits = CallLimits(concurrent, per_minute, timeout, retries, corrections, tool_calls)
        ledger = Ledger(Budget.of("budget", budget), Budget.of("agent_budget", agent_budget))
        if not prices and "cost" in {*(budget or {}), *(agent_budget or {})}:
            raise MisuseError("llm: a budget of cost needs prices, or nothing costs anything")
        self._setup = CallSetup(
            chosen, {}, system, Prices(prices), ledger, CompletionCache(cache), self._log,
            ToolServers.of(tools, concurrent, self._log),
        )  # fmt: skip
        # Answers of a script take simulated time, so frames can wait for them.
        self._waits = self.coupled = wait or chosen.scripted
        if self._waits:
            self.when = "each frame"
        self._dt = 0.1
        self._caller: CallRunner | None = None
        self._lock = threading.Lock()
        self._open: dict[RequestKey, MindRequest] = {}
        self._ended: dict[RequestKey, tuple[float, RequestResult]] = {}
        self._skeleton: Scene | None = None
        self._there: frozenset[str] = frozenset()
        self._counts: Counter[str] = Counter()
        self._logged: set[str] = set()

    def joined(self, world: WorldInfo) -> None:
        backend = self._setup.backend
        if isinstance(backend, HttpBackend):
            require("llm", "httpx", "httpx", "llm")
            self._read_key()  # A missing key is reported here.
        if self._setup.tools:
            require("llm", "mcp", "mcp", "mcp")
        for ours in (eReply, eThink):
            if event_type("llm", world, ours.name).fields != ours.fields:
                raise MisuseError(f"llm: the world declares a different {ours.name}; use *MINDS")
        self._dt = world.dt
        self._setup = replace(self._setup, events=world.vocabulary.events)
        self._caller = CallRunner(self._setup, self._limits)

    def close(self) -> None:
        if self._caller is not None:
            self._caller.close()

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Open requests, results by outcome, and what calls have used."""
        total = self._setup.ledger.total
        used = {"calls": total.calls, "tokens": total.tokens_in + total.tokens_out}
        # Where frames wait for calls, replies wait for the frame that is due.
        pending = len(self._ended if self._waits else self._open)
        if self._setup.tools:
            used["tools"] = self._setup.tools.used
        return {"pending": pending, **self._counts, **used, "cost": total.cost}

    # --- open requests ---

    def show(self, view: View) -> None:
        """Begin new requests, and cancel those that are no longer open (α of `PRequests`)."""
        shown = OpenRequests()
        interpret(view.scene, shown)
        caller = cast("CallRunner", self._caller)
        if self._skeleton is None:
            # What a former process of the service has used counts, too.
            self._setup.ledger.begin(shown.accounts())
        left = self._agents_left(view)
        with self._lock:
            for key, asked in shown.requests.items():
                if key in self._ended:
                    self._repeat(key, caller)
                elif key not in self._open:
                    self._open[key] = asked
                    caller.ask(asked)
            # Calls for which frames wait end within a frame.
            for key, asked in [] if self._waits else self._open.items():
                if key not in shown.requests or asked.request.asker in left:
                    caller.cancel(key)
            for key in self._ended.keys() - shown.requests.keys():
                del self._ended[key]

    def _agents_left(self, view: View) -> frozenset[str]:
        """The outermost agents that have disappeared since the previous view."""
        if view.skeleton is self._skeleton:
            return frozenset()
        self._skeleton = view.skeleton
        before, self._there = self._there, frozenset(node.id for node in agents(view.skeleton))
        return before - self._there

    def _repeat(self, key: RequestKey, caller: CallRunner) -> None:
        """Send a reply again that was lost, for example with a coordinator that was killed."""
        sent, result = self._ended[key]
        if not self._waits and time.monotonic() - sent > RESEND_SECONDS:
            self._ended[key] = time.monotonic(), result
            caller.results.put(result)

    # --- results ---

    def generate(self, tick: Tick) -> Iterable[Event]:
        """The replies that are due in a frame; waits for all calls."""
        results = cast("CallRunner", self._caller).results
        while self._open:
            self._note(results.get())
        due = [
            result
            for _, (_, result) in sorted(self._ended.items(), key=lambda item: item[0])
            if self._is_due(result, tick.number)
        ]
        return [_reply(result, result.simulated) for result in due]

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Emit replies as they arrive."""
        results = cast("CallRunner", self._caller).results
        while not stop.is_set():
            try:
                result = results.get(timeout=POLL_SECONDS)
            except Empty:
                continue
            self._note(result)
            emit(_reply(result, round(result.seconds, 3)))

    def _note(self, result: RequestResult) -> None:
        with self._lock:
            if self._open.pop(result.asked.key, None) is not None:
                self._counts["cached" if result.cached else result.outcome] += 1
            self._ended[result.asked.key] = time.monotonic(), result

    def _is_due(self, result: RequestResult, frame: int) -> bool:
        """Whether a reply belongs to a frame; depends on nothing but the request.

        The view of the frame after the reply still has the request. It is answered again only
        after that, if the reply has not counted because the service has just joined.
        """
        frames = math.ceil(result.simulated / self._dt)
        late = frame - result.asked.request.frame - max(frames, SHOWN_AFTER)
        return late >= 0 and late % 2 == 0

    def _log(self, line: str) -> None:
        """Log each problem once, up to a limit."""
        if line not in self._logged and len(self._logged) < MAX_LOGGED:
            self._logged.add(line)
            log(line)


def _reply(result: RequestResult, seconds: float) -> Event:
    usage, asked = result.usage, result.asked
    reply: Event = eReply(
        asked.request.number,
        asked.request.asker,
        result.outcome,
        result.content,
        result.model,
        result.cached,
        seconds,
        usage.calls,
        usage.tokens_in,
        usage.tokens_out,
        usage.cost,
        json.dumps([asdict(used) for used in result.tools]) if result.tools else "",
        receivers=[asked.mind],
    )
    return reply


def _key_reader(variable: str, file: str) -> Callable[[], str]:
    """Reads the API key from its source. Raises MisuseError if there are two sources."""
    if variable and file:
        raise MisuseError("llm: set key_env or key_file, not both")
    return lambda: read_password("llm", variable, file) if variable or file else ""


def _backend(chosen: Any, server: Callable[[str], Backend]) -> Backend:
    """The backend that an option describes; `server` makes that of a URL. Raises MisuseError."""
    if isinstance(chosen, list | tuple):
        command = [str(word) for word in cast("list[Any]", chosen)]
        if not command:
            raise MisuseError("llm: backend is an empty list; expected a program and arguments")
        return CommandBackend(command)
    if not isinstance(chosen, str) or not chosen:
        raise MisuseError(
            "llm: backend must be a base URL, a script FILE.toml, module:name or a list with a"
            f" program and its arguments, not {chosen!r:.60}"
        )
    if chosen.lower().startswith(("http://", "https://")):
        return server(chosen)
    if chosen.endswith(".toml"):
        return ScriptBackend.read(Path(chosen))
    named = load(chosen)
    return FunctionBackend(chosen, named) if callable(named) else ScriptBackend(chosen, named)
