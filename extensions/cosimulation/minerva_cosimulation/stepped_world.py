"""A world that another program steps: events as inputs, attributes of agents as outputs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, cast

import numpy as np

from minerva_bus.api.live import Live
from minerva_bus.api.world import World, world_of
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.scene import AgentNode, agents
from minerva_bus.grammar.vocabulary import EventType, Vocabulary

ALL: Final = ""
"""In place of an agent's id: an event for all agents that respond to its type."""


class SteppedWorld:
    """A world in this process, paused between two steps.

    Inputs are data of events: `eHeat.watts` of an event for all agents that respond to `eHeat`,
    `room.eHeat.watts` of one for the agent `room`. Each step sends the events of which a datum was
    set since the previous one, sorted by type and receiver; data that were not set keep their
    value, or have the default of the vocabulary. Outputs are attributes: `room.celsius`, and events
    that agents have sent: `eAlarm`, or `room.eAlarm` of one agent.

    Args:
        world: a `World`, a world file, or the name of an installed world.
        seed: of all random numbers; default: the world's own.
        options: the world's own options.

    Raises MinervaError if the world cannot start.

    """

    def __init__(self, world: World | str | Path, seed: int | None = None, **options: Any) -> None:
        settings: dict[str, Any] = {} if seed is None else {"seed": seed}
        if isinstance(world, World):
            settings |= options
        self._live: Live = world_of(world, options).start(**settings)
        self._values: dict[tuple[str, str], dict[str, Any]] = {}
        self._due: set[tuple[str, str]] = set()
        self._agents: dict[str, AgentNode] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.close()

    @property
    def vocabulary(self) -> Vocabulary:
        """Its symbols and event types."""
        return self._live.vocabulary

    @property
    def frame(self) -> int:
        """The number of completed frames."""
        return self._live.frame

    @property
    def digest(self) -> str:
        """The digest of the string, in hexadecimal."""
        return self._live.digest

    @property
    def agents(self) -> Mapping[str, AgentNode]:
        """The agents of the string, by id."""
        if self._agents is None:
            self._agents = {agent.id: agent for agent in agents(self._live.scene)}
        return self._agents

    def set(self, name: str, value: Any) -> None:
        """Set an input for the next step. Raises MisuseError if there is no such input."""
        agent, event_type, datum = self._input(name)
        place = event_type.name, agent
        self._values.setdefault(place, {})[datum] = _plain(value)
        self._due.add(place)

    def get(self, name: str) -> Any:
        """The value of an output: a bool, number, text, or list of these. Raises MisuseError."""
        node, attribute = self._output(name)
        return _plain(node.state[attribute])

    def publish(self, name: str, **data: Any) -> None:
        """Send an event in the next step: `eHeat`, or `room.eHeat` for one agent.

        Raises MinervaError as `set` and `step` do.
        """
        agent, event_type = self._event(name, name)
        self._live.publish(event_type(**data, receivers=[agent] if agent else []))

    def sent(self, name: str) -> tuple[Event, ...]:
        """Events that agents sent in the last frame: `eAlarm`, or `room.eAlarm` of one agent."""
        agent, _, event_type = name.rpartition(".")
        return tuple(
            event
            for event in self._live.sent
            if event.type == event_type and agent in (ALL, event.sender)
        )

    def event_type(self, name: str) -> EventType:
        """The type of `eHeat` or `room.eHeat`. Raises MisuseError if there is none."""
        return self._event(name, name)[1]

    def input_field(self, name: str) -> Field:
        """The type and default of an input. Raises MisuseError if there is no such input."""
        _, event_type, datum = self._input(name)
        return _field(event_type.fields, datum)

    def output_field(self, name: str) -> Field:
        """The type of an output. Raises MisuseError if there is no such output."""
        node, attribute = self._output(name)
        return _field(self.vocabulary.kinds[node.symbol].fields, attribute)

    def step(self, frames: int = 1) -> None:
        """Send the inputs that were set, and run this number of frames.

        Raises MinervaError for values that do not fit their event type, for events that people may
        not send, if the world has ended, and if its code fails.
        """
        for event_type, agent in sorted(self._due):
            receivers = [agent] if agent else []
            values = self._values[event_type, agent]
            self._live.publish(self.vocabulary.events[event_type](**values, receivers=receivers))
        self._due.clear()
        before = self.frame
        self._live.step(frames)
        self._agents = None
        if self.frame < before + frames:
            raise MisuseError(
                f"the world ended after frame {self.frame}, {before + frames - self.frame} before"
                " the end of the step; a world in a co-simulation must not end by itself"
            )

    def close(self) -> None:
        """End the world."""
        self._live.close()

    def _agent(self, agent: str, name: str) -> AgentNode:
        if agent not in self.agents:
            raise MisuseError(
                f"{name}: the string has no agent {agent!r} in frame {self.frame}"
                f"{nearest(agent, list(self.agents))}"
            )
        return self.agents[agent]

    def _output(self, name: str) -> tuple[AgentNode, str]:
        """The agent and the attribute of an output."""
        agent, _, attribute = name.partition(".")
        node = self._agent(agent, name)
        if attribute not in node.names:
            raise MisuseError(
                f"{name}: {node.symbol} has no attribute {attribute!r}"
                f"{nearest(attribute, list(node.names))}"
            )
        return node, attribute

    def _input(self, name: str) -> tuple[str, EventType, str]:
        """The agent ("": all), event type and datum of an input."""
        place, _, datum = name.rpartition(".")
        if place.count(".") > 1 or not place:
            raise MisuseError(
                f"{name!r} is not an input; expected EVENT.DATUM or AGENT.EVENT.DATUM"
            )
        agent, event_type = self._event(place, name)
        names = event_type.fields.names
        if datum not in names:
            event = event_type.name
            raise MisuseError(f"{name}: {event} has no {datum!r}{nearest(datum, list(names))}")
        return agent, event_type, datum

    def _event(self, place: str, name: str) -> tuple[str, EventType]:
        """The agent ("": all) and the event type of `eHeat` or `room.eHeat`, a part of a name."""
        agent, _, event = place.rpartition(".")
        if agent:
            self._agent(agent, name)
        events = self.vocabulary.events
        if event not in events:
            raise MisuseError(
                f"{name}: the world has no event type {event}{nearest(event, list(events))}"
            )
        return agent, events[event]


def _field(fields: Fields, name: str) -> Field:
    return next(field for field in fields.all if field.name == name)


def _plain(value: Any) -> Any:
    """A value without types of numpy."""
    if isinstance(value, np.ndarray | np.generic):
        return cast("Any", value).tolist()
    return value
