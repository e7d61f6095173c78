"""People on pages: their orders, and what a page shows about an agent, or about two runs.

`minerva explain` finds the causes of a value, and `minerva bisect` where the run parts from
another one, in processes of their own: they run code of agents, which must not stop the page's
server. For a replay they read the record that is replayed.
"""

from __future__ import annotations

import asyncio
import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, cast

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.text_and_digest import shown_value
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.world.operator import WorldStatus
from minerva_bus.world.services import WorldInfo
from minerva_services.geometry.colors import SCALES
from minerva_services.views.fates import LatestOrders, shown_person
from minerva_services.views.page.names import PageNames
from minerva_services.views.page.site import PageSite
from minerva_services.views.reports import LatestReport
from minerva_services.views.window.actions import AdjustAction, OrderAction, SentNumbers
from minerva_services.views.window.order_types import order_types

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection


POLL_SECONDS: Final = 0.25
_MAX_RECEIVERS: Final = 100
_MAX_STEPS: Final = 10
_LEAST_RATE: Final = 0.5
_MAX_ORDERS: Final = 8
"""Orders that pages list."""


@dataclass(frozen=True, slots=True)
class PageOptions:
    """What pages draw, at most how many views per second, and which order types gestures send.

    `beside`: the record of a run with which pages compare this one, or "".
    """

    draws: tuple[str, ...]
    rate: float
    click: str = ""
    slide: str = ""
    beside: str = ""


def sent_types(
    vocabulary: Vocabulary, orders: Sequence[str], options: PageOptions
) -> dict[str, Any]:
    """The event types that gestures on a page send.

    `click` has one text, `slide` one real number, `place` the coordinates `x` and `y`; those in
    `plain` have no data.
    """
    types = order_types(vocabulary, orders, options.click, options.slide)
    taken = [vocabulary.events[name] for name in sorted(orders) if name in vocabulary.events]
    place = next((declared.name for declared in taken if _is_place(declared)), None)
    click = types.click
    return {
        "click": {"type": click.name, "name": click.fields.names[0]} if click else None,
        "slide": types.slide.name if types.slide else None,
        "place": place,
        "plain": [declared.name for declared in types.plain],
    }


def _is_place(declared: EventType) -> bool:
    kinds = [(field.name, field.type.kind) for field in declared.fields.all]
    return kinds == [("x", "real"), ("y", "real")]


class People:
    """The links to pages over which their users take part: text messages in JSON.

    A page sends `{order, data, to}`, `{slide, steps, to}`, `{toggle}`, `{step}`, `{rate}`,
    `{seek}`, `{pause}`, `{name}`, `{state}`, `{explain}` and `{bisect}`, and receives `{welcome}`,
    `{status}`, `{orders}`, `{you}`, `{state}`, `{explained}`, `{bisected}`, `{note}`, `{error}` and
    `{ended}`.
    """

    def __init__(
        self, world: WorldInfo, options: PageOptions, names: PageNames, site: PageSite
    ) -> None:
        self._world = world
        self._options = options
        self._names = names
        self._site = site
        self._inspector = Inspector(world, options.beside)
        self._orders = LatestOrders(_MAX_ORDERS)
        self._reports = LatestReport(world.vocabulary)
        self._numbers = SentNumbers()
        self._pages: set[ServerConnection] = set()
        self._status: dict[str, Any] = {
            "types": {}, "paused": False, "report": "", "taken": [], "end": 0, "people": []
        }  # fmt: skip

    # --- pages ---

    async def serve(self, page: ServerConnection) -> None:
        """Serve a page until it closes."""
        from websockets.exceptions import ConnectionClosed

        with self._names.page() as number:
            self._pages.add(page)
            try:
                welcome = {"welcome": self._welcome(number), "status": self._status}
                await self._send(page, {**welcome, "orders": self._orders.plain()})
                async with asyncio.TaskGroup() as questions:
                    asked: dict[str, asyncio.Task[None]] = {}
                    async for text in page:
                        question = _question(text)
                        if question is None:
                            await self._send(page, await self._reply(text, number))
                            continue
                        # A person who asks again no longer waits for the earlier answer.
                        if question.reply in asked:
                            asked[question.reply].cancel()
                        task = questions.create_task(self._answer(page, question))
                        asked[question.reply] = task
                    for task in asked.values():
                        task.cancel()
            except* ConnectionClosed:
                pass
            finally:
                self._pages.discard(page)

    async def _answer(self, page: ServerConnection, question: Question) -> None:
        try:
            answer: dict[str, Any] = {"answer": await self._inspector.answer(question)}
        except MinervaError as error:
            answer = {"problem": str(error)}
        await self._send(page, {question.reply: {**asdict(question), **answer}})

    def _welcome(self, number: int) -> dict[str, Any]:
        return {
            "world": self._world.world,
            "page": self._names.of_page(number),
            "draws": self._options.draws,
            "rate": self._options.rate,
            "scales": SCALES,
            "beside": Path(self._options.beside).name,
            "module": self._site.module,
            "joins": self._names.joins_of(number),
            "you": shown_person(self._names.person(number)),
        }

    async def end(self, why: str) -> None:
        """Tell all pages that there is nothing more to come."""
        self.broadcast({"ended": why})
        for page in list(self._pages):
            await page.close()

    def broadcast(self, message: Mapping[str, Any]) -> None:
        """Send a message to all pages; those that do not read miss it."""
        from websockets.asyncio.server import broadcast

        broadcast(self._pages, json.dumps(message))

    @staticmethod
    async def _send(page: ServerConnection, message: Mapping[str, Any]) -> None:
        await page.send(json.dumps(message))

    # --- the state of the world ---

    async def watch(self) -> None:
        """Query the world's state and send changes to all pages, until cancelled."""
        problem = ""
        while True:
            await asyncio.sleep(POLL_SECONDS)
            if not self._pages:
                continue
            try:
                operator = self._world.operator
                self._update(await asyncio.to_thread(operator.status, self._reports.last))
                if await asyncio.to_thread(self._orders.update, operator):
                    self.broadcast({"orders": self._orders.plain()})
                problem = ""
            except MinervaError as error:
                if problem != str(error):
                    problem = str(error)
                    self.broadcast({"error": problem})

    def _update(self, status: WorldStatus) -> None:
        self._reports.update(status)
        now = {
            "types": sent_types(self._world.vocabulary, status.orders, self._options),
            "paused": status.paused,
            "report": self._reports.text,
            "taken": self._names.taken,
            "end": status.end,
            "people": [shown_person(name) for name in self._names.people],
        }
        if now != self._status:
            self._status = now
            self.broadcast({"status": now})

    # --- actions ---

    async def _reply(self, text: str | bytes, number: int) -> dict[str, Any]:
        try:
            action = _read(text)
            match action:
                case {"name": str(name)}:
                    self._names.choose(number, name)
                    return {"you": shown_person(self._names.person(number))}
                case {"state": str(agent)}:
                    return {"state": await asyncio.to_thread(self._inspector.state, agent)}
                case _:
                    person = self._names.person(number)
                    return {"note": await asyncio.to_thread(self._do, action, person)}
        except MinervaError as error:
            return {"error": str(error)}

    def _do(self, action: Mapping[str, Any], person: str) -> str:
        """Perform a person's action; returns a line for the user. Raises MinervaError."""
        operator = self._world.operator.named(person)
        match action:
            case {"order": str(name), "data": dict(data), "to": list(to)}:
                return OrderAction(self._event(name, cast("Any", data), _ids(cast("Any", to)))).do(
                    operator
                )
            case {"slide": str(name), "steps": int(steps), "to": list(to)}:
                declared, receivers = self._event_type(name), _ids(cast("Any", to))
                like = receivers[0] if receivers else ""
                steps = max(-_MAX_STEPS, min(steps, _MAX_STEPS))
                change = AdjustAction(
                    declared, steps, like, receivers, self._world.vocabulary, self._numbers
                )
                return change.do(operator)
            case {"toggle": "pause"}:
                # Decided here: a page learns only later that somebody has paused the world.
                if operator.status().paused:
                    operator.resume()
                    return ""
                operator.pause()
                return "paused"
            case {"seek": int(frame)}:
                operator.seek(frame)
                return ""
            case {"pause": int(frame)}:
                operator.pause()
                operator.seek(frame)
                return f"paused at frame {frame}"
            case {"step": 1}:
                operator.step(1)
                return ""
            case {"rate": (1 | -1) as steps}:
                status = operator.status()
                rate = max(_LEAST_RATE, (status.rate or status.hz) * 2.0**steps)
                operator.set_rate(rate)
                return f"target rate {rate:g} frames per second"
            case _:
                raise MisuseError("the page's server does not know this action")

    def _event_type(self, name: str) -> EventType:
        declared = self._world.vocabulary.events.get(name)
        if declared is None:
            raise MisuseError(f"the world has no event type {name[:64]!r}")
        return declared

    def _event(self, name: str, data: Mapping[str, Any], receivers: tuple[str, ...]) -> Event:
        declared = self._event_type(name)
        unknown = sorted(set(data) - set(declared.fields.names))
        if unknown:
            raise MisuseError(f"{name} has no {unknown[0][:64]!r}")
        return declared(**data, receivers=receivers)


def _question(text: str | bytes) -> Question | None:
    """The question in a page's message; None for any other message."""
    try:
        match _read(text):
            case {"explain": str(agent), "attribute": str(attribute), "frame": int() | None as at}:
                return AgentQuestion(agent, attribute, at)
            case {"bisect": True}:
                return RunsQuestion()
            case _:
                return None
    except MinervaError:
        return None


def _ids(to: list[object]) -> tuple[str, ...]:
    if len(to) > _MAX_RECEIVERS or not all(isinstance(agent, str) for agent in to):
        raise MisuseError("the receivers of an order are ids of agents")
    return tuple(cast("list[str]", to))


def _read(text: str | bytes) -> Mapping[str, Any]:
    try:
        action = json.loads(text)
    except (ValueError, RecursionError):
        action = None
    if not isinstance(action, dict):
        raise MisuseError("the page's server expects JSON objects")
    return cast("Mapping[str, Any]", action)


MAX_SECONDS: Final = 120.0
"""Time limit of an answer in seconds; on a busy machine it takes long."""

MAX_PROCESSES: Final = 2
"""Answers that are computed at the same time, for all pages."""


@dataclass(frozen=True, slots=True)
class AgentQuestion:
    """An agent, an attribute or "" for all, and a frame or None for the latest recorded one.

    A page finds the question of an answer by these fields.
    """

    reply: ClassVar[str] = "explained"
    agent: str
    attribute: str = ""
    frame: int | None = None


@dataclass(frozen=True, slots=True)
class RunsQuestion:
    """Where the run parts from the one beside it."""

    reply: ClassVar[str] = "bisected"


Question = AgentQuestion | RunsQuestion


class Inspector:
    """Answers questions of pages about one world, and the record `beside` its own."""

    def __init__(self, world: WorldInfo, beside: str = "") -> None:
        self._world = world
        self._beside = beside
        self._processes = asyncio.Semaphore(MAX_PROCESSES)

    def state(self, agent: str) -> dict[str, Any]:
        """The present state of an agent: `kind` and `state`, by name. Raises MinervaError."""
        scene = self._world.vocabulary.read(self._world.operator.fragment(agent))
        node = scene.nodes[0] if scene.nodes else None
        if not isinstance(node, AgentNode):
            raise MisuseError(f"there is no agent #{agent[:64]}")
        state = {name: shown_value(node.state[name]) for name in node.names}
        return {"agent": node.id, "kind": node.symbol, "state": state}

    async def answer(self, question: Question) -> dict[str, Any]:
        """The answer of `minerva explain` or `minerva bisect`, as a JSON object.

        Raises MinervaError with the command's message if it has none.
        """
        status = await asyncio.to_thread(self._world.operator.status)
        record = next((file.path for file in status.files if file.name == "record"), "")
        if isinstance(question, AgentQuestion):
            about = record if status.end else status.world
            words = ["explain", about, f"--agent={question.agent}"]
            words += [f"--attribute={question.attribute}"] if question.attribute else []
            words += [f"--frame={question.frame}"] if question.frame is not None else []
        elif not (record and self._beside):
            what = "--record FILE" if self._beside else "--view page:beside=FILE"
            raise MisuseError(f"there are no two records to compare: start this world with {what}")
        else:
            words = ["bisect", record, self._beside]
        async with self._processes:
            return await _answer_of(*words, "--json")


async def _answer_of(*words: str) -> dict[str, Any]:
    """The answer of a command, computed in a process of its own. Raises MinervaError."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "minerva_bus",
        *words,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        output, errors = await asyncio.wait_for(process.communicate(), MAX_SECONDS)
    except TimeoutError:
        command = shlex.join(("minerva", *words[:-1]))
        raise MinervaError(f"no answer within {MAX_SECONDS:g} s; try {command}") from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    try:
        answer = json.loads(output)
    except ValueError:
        text = errors.decode(errors="replace").strip() or f"minerva {words[0]} failed"
        raise MinervaError(text) from None
    if "error" in answer:
        raise MinervaError(str(answer["error"]))
    return answer
