"""Services and parameters of a robot: figures of agents are requests, answers are events."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, cast

from minerva_bus.errors import MinervaError, MisuseError, nearest
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.services import View, WorldInfo
from minerva_services.bridges.ros2.client import PLACE, RobotClient, check_primitive, figures_of
from minerva_services.bridges.ros2.layout import Ros2Network, check_name
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros2.uses import missing_server
from minerva_services.bridges.ros_messages import GarbageError
from minerva_services.bridges.ros_messages.definitions import (
    MessageEvents,
    ServiceType,
    built,
    checked_table,
    service_type,
    shape_of,
)
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.event_factory import EventFactory, event_type
from minerva_services.options import check_positive, takes_options

_KEYS: Final[Mapping[str, Any]] = {
    "service": str, "type": str, "definition": str, "request": Mapping,
    "node": str, "parameter": str, "value": object,
    "event": str, "data": Mapping, "timeout": int | float,
}  # fmt: skip
"""Keys of the table of a call, with the types of their values."""

_OF_PARAMETERS: Final = ("node", "parameter", "event")
_OF_SERVICES: Final = ("service", "type", "event")
"""Keys that are needed."""

_TIMEOUT: Final = 5.0
_MAX_WAITING: Final = 100
"""Maximum of requests that are not answered yet."""

_EXAMPLES: Final = {"bool": False, "int": 0, "real": 0.0, "text": ""}
_PARAMETERS: Final = "rcl_interfaces/srv"
_VALUES: Final = (
    "", "bool_value", "integer_value", "double_value", "string_value", "byte_array_value",
    "bool_array_value", "integer_array_value", "double_array_value", "string_array_value",
)  # fmt: skip
"""Fields of a ParameterValue by its type."""

_TYPES: Final[tuple[type, ...]] = (bool, int, float, str)
"""Types of parameters from 1 on, and of lists of them from 6 on."""


@dataclass(frozen=True, slots=True)
class Call:
    """How figures of a symbol are requests: to which service, and what becomes of the answer.

    `read` makes what events are made of from an answer, of this `shape`; it raises CallError for an
    answer that is a refusal.
    """

    symbol: str
    service: str
    type: ServiceType
    request: Any
    shape: Mapping[str, Any]
    read: Callable[[Any], Any]
    event: str
    data: Mapping[str, str]
    timeout: float

    def events(self, declared: EventType) -> MessageEvents:
        """Makes events of its answers. Raises MisuseError if the type does not fit."""
        return MessageEvents(f"ros2_calls: calls.{self.symbol}", declared, self.data, self.shape)


class CallError(MinervaError):
    """A service has refused a request."""


def call_of(symbol: str, given: Any, folder: str = "") -> Call:
    """A call from its table in a world file. Raises MisuseError."""
    where = f"ros2_calls: calls.{symbol}"
    is_parameter = isinstance(given, Mapping) and "parameter" in given
    table = checked_table(where, given, _KEYS, _OF_PARAMETERS if is_parameter else _OF_SERVICES)
    common = {
        "symbol": symbol, "event": table["event"], "data": table.get("data", {}),
        "timeout": check_positive(where, "timeout", table.get("timeout", _TIMEOUT)),
    }  # fmt: skip
    if is_parameter:
        return _parameter(table["node"], table["parameter"], table.get("value"), common)
    check_name("a service", table["service"])
    kind = service_type(table["type"], table.get("definition", ""), folder)
    return Call(
        service=table["service"], type=kind, request=table.get("request", {}),
        shape=shape_of(kind.answer), read=lambda answer: answer, **common,
    )  # fmt: skip


def _parameter(node: str, name: str, value: Any, common: Mapping[str, Any]) -> Call:
    """Set a parameter of a node to a value, or get it without a value."""
    check_name("a node", node)
    about = {"node": node, "parameter": name}
    shape = dict.fromkeys(about, Type("text"))

    def read_set(answer: Any) -> Any:
        if not answer.results or not answer.results[0].successful:
            reason = answer.results[0].reason if answer.results else ""
            raise CallError(f"{name} is refused: {reason or 'no reason is given'}")
        return about

    def read_got(answer: Any) -> Any:
        if not answer.values or not 0 < answer.values[0].type < len(_VALUES):
            raise CallError(f"{node} has no parameter {name}")
        return {**about, "value": getattr(answer.values[0], _VALUES[answer.values[0].type])}

    if value is None:
        return Call(
            service=f"{node}/get_parameters", type=service_type(f"{_PARAMETERS}/GetParameters"),
            request={"names": [name]}, shape={**shape, "value": None}, read=read_got, **common,
        )  # fmt: skip
    return Call(
        service=f"{node}/set_parameters", type=service_type(f"{_PARAMETERS}/SetParameters"),
        request={"parameters": [{"name": name, "value": _Parameter(value)}]},
        shape=shape, read=read_set, **common,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Parameter:
    """A template for a ParameterValue: a value whose Python type decides its type."""

    value: Any


def filled(template: Any, names: Mapping[str, Any]) -> Any:
    """A request with the values of `"{name}"` in place. Raises MisuseError for unknown names."""
    if isinstance(template, Mapping):
        table = cast("Mapping[str, Any]", template)
        return {key: filled(value, names) for key, value in table.items()}
    if isinstance(template, list):
        return [filled(value, names) for value in cast("list[Any]", template)]
    if isinstance(template, _Parameter):
        value = filled(template.value, names)
        of = value[0] if isinstance(value, list | tuple) and value else value
        number = next((n for n, kind in enumerate(_TYPES, 1) if type(of) is kind), 0)
        number += 5 if number and of is not value else 0
        if not number and value != ():
            raise MisuseError(f"{value!r:.40} cannot be the value of a parameter")
        return {"type": number, _VALUES[number]: value}
    if isinstance(template, str) and template.startswith("{") and template.endswith("}"):
        name = template[1:-1]
        if name not in names:
            raise MisuseError(f"the figure has no {name}{nearest(name, list(names))}")
        return names[name]
    return template


class Ros2Calls(RobotClient):
    """Asks services of a robot, and gets and sets parameters of its nodes.

    A figure that appears in an agent's view is a request, and again if its parameters change; the
    answer is an event for this agent. Without an answer it receives `failed`, with the reason.

    Args:
        router: the endpoint of the robot's network; its other options are those of `Ros2Network`.
        calls: by primitive, a table: `service` and `type`, or `node` and `parameter`; `request`
          or `value`, in which "{name}" is a parameter of the figure; `event`, with the paths of its
          `data` in the answer; `timeout` in seconds; `definition` of a type that is not known.
        definitions: a folder with definitions of types, as /opt/ros/jazzy/share.
        draws: the visual event type whose views contain the figures.
        failed: the type of the event without an answer, with the data `call` (the primitive) and
          `why`.

    """

    @takes_options(Ros2Network)
    def __init__(
        self,
        router: str,
        calls: Mapping[str, Any] | None = None,
        definitions: str = "",
        draws: str = "ePicture",
        failed: str = "eCallFailed",
        **network: Any,
    ) -> None:
        super().__init__(Ros2Network(router, **network), "minerva_calls", draws)
        self._given, self._folder, self._failed = dict(calls or {}), definitions, failed
        self._waiting: list[_Request] = []
        self._shown = set[str]()

    def generates(self) -> tuple[str, ...]:
        """The event types of the answers, and of failures."""
        # A table that is wrong is reported by `check`.
        tables = [table for table in self._given.values() if isinstance(table, Mapping)]
        events = [table["event"] for table in tables if isinstance(table.get("event"), str)]
        return tuple(dict.fromkeys([*events, self._failed]))

    def check(self, world: WorldInfo) -> None:
        """Raises MisuseError if rosbags is missing, or a call does not fit its world or type."""
        messages()
        if not self._given:
            raise MisuseError("ros2_calls: nothing to do; give calls")
        self._vocabulary = world.vocabulary
        self._fail = EventFactory("ros2_calls", world, self._failed, call=str, why=str)
        self._calls, self._answers = dict[str, Call](), dict[str, MessageEvents]()
        for symbol, table in self._given.items():
            check_primitive("ros2_calls", world, symbol)
            call = self._calls[symbol] = call_of(symbol, table, self._folder)
            self._answers[symbol] = call.events(event_type("ros2_calls", world, call.event))
            self.network.name(call.service)
            # The request of a figure with examples of its parameters.
            fields = world.vocabulary.primitives[symbol].fields.all
            own = {each.name: _EXAMPLES.get(each.type.kind, ()) for each in fields}
            try:
                made = filled(call.request, {**dict.fromkeys(PLACE, 0.0), **own})
                if () not in own.values():
                    built(call.type.request, made)
            except MisuseError as error:
                raise MisuseError(f"ros2_calls: calls.{symbol}: {error}") from None

    def servers(self) -> Sequence[tuple[str, str]]:
        """The services of its calls. Raises MisuseError for a call that is wrong."""
        calls = [call_of(symbol, table, self._folder) for symbol, table in self._given.items()]
        return [(call.service, call.type.name) for call in calls]

    def show(self, view: View) -> None:
        """Ask what new figures ask."""
        shown = set[str]()
        for agent, scene in sorted(view.parts.items()):
            for symbol, names in figures_of(scene, self._vocabulary, self._calls):
                text = f"{agent} {symbol} {sorted(names.items())}"
                if text not in self._shown | shown:
                    self.do(partial(self._ask, agent, self._calls[symbol], names))
                shown.add(text)
        self._shown = shown

    def save(self) -> Mapping[str, Any]:
        """The requests of the last view, which a successor must not repeat."""
        return {"shown": sorted(self._shown)}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Continue from a saved state."""
        self._shown = set(saved["shown"])

    def _ask(self, agent: str, call: Call, names: Mapping[str, Any]) -> None:
        request = _Request(agent, call, time.monotonic() + call.timeout)
        self._waiting.append(request)
        if len(self._waiting) > _MAX_WAITING:
            request.problem = f"{_MAX_WAITING} other requests wait"
            return
        try:
            message = built(call.type.request, filled(call.request, names))
            request.data = messages().encode(call.type.request, message)
        except MisuseError as error:
            request.problem = str(error)

    def advance(self, session: Ros2Session | None) -> Iterator[Event]:
        """Send requests, and yield the events of those that are answered or too late."""
        for request in list(self._waiting):
            call, left = request.call, request.until - time.monotonic()
            if session is None:
                reason = f"{self.network.router}: {self.state}"
            elif session.server(call.service, call.type.name) is None:
                reason = missing_server(session.graph, self.network, call.service, call.type.name)
            else:
                reason = f"no answer of {call.service} within {call.timeout:g} s"
                if request.data and left > 0:
                    data, request.data = request.data, b""
                    answer = partial(self.do, request.answered)
                    session.call(call.service, call.type.name, data, left, answer)
            if left <= 0:
                request.problem = request.problem or reason
            if request.problem or request.answer is not None:
                self._waiting.remove(request)
                yield self._event(request)

    def _event(self, request: _Request) -> Event:
        call, problem = request.call, request.problem
        if not problem:
            try:
                answer = messages().decode(call.type.answer, request.answer or b"")
                event = self._answers[call.symbol](call.read(answer), [request.agent])
            except (GarbageError, CallError) as error:
                problem = f"{call.service}: {error}"
            else:
                self.count("answers")
                return event
        self.count("failed calls")
        return self._fail(call.symbol, problem, receivers=(request.agent,))


@dataclass(slots=True)
class _Request:
    """A request of an agent: `data` while it is not sent yet; then its answer or its problem."""

    agent: str
    call: Call
    until: float
    data: bytes = b""
    answer: bytes | None = None
    problem: str = ""

    def answered(self, answer: bytes | None, problem: str) -> None:
        """Receive what has become of it."""
        self.answer, self.problem = answer, problem
