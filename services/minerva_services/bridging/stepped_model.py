"""A model of another program that takes part in a world, which steps it once per frame."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from math import isfinite
from typing import Any, Protocol

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import FigureNode, walk
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.event_factory import event_type
from minerva_services.options import names_in


class Model(Protocol):
    """An instance of a model. Its methods raise MisuseError if the model fails."""

    def set(self, name: str, value: Any) -> None:
        """Set an input for the next step."""
        ...

    def get(self, name: str) -> Any:
        """The value of an output after the last step."""
        ...

    def step(self, time: float, duration: float) -> None:
        """Step from a time for a duration, in simulated seconds."""
        ...

    def close(self) -> None:
        """End the model."""
        ...


class SteppedModel(Device, Generator, coupled=True):
    """Steps a model by one frame per frame, and sends its outputs as an event.

    Args:
        name: the name of the service, for messages.
        event: the event type of the outputs.
        outputs: the variable of each datum of this event: "celsius=room.T, ...".
        inputs: the parameter of a primitive for each variable: "heat=PHeater.watts, ...".
        draws: the visual event types whose views contain these figures, comma-separated.
        starts: start values of variables: "capacity=2000, ...".

    Raises MisuseError for invalid options.

    """

    def __init__(
        self, name: str, event: str, outputs: str, inputs: str, draws: str, starts: str
    ) -> None:
        self._name, self._event = name, event
        self.draws = names_in(draws)
        # A view belongs to each frame, because the model is stepped in each.
        self.when = "each frame" if self.draws else ""
        self.outputs = self.pairs("outputs", outputs)
        self.inputs = {
            variable: self._parameter(source)
            for variable, source in self.pairs("inputs", inputs).items()
        }
        self.starts = {
            variable: self.number(variable, text)
            for variable, text in self.pairs("starts", starts).items()
        }
        if self.inputs and not self.draws:
            raise MisuseError(f"{name}: inputs need draws, the visual event type of their figures")
        self._values: dict[str, Any] = {}
        self._model: Model | None = None

    @abstractmethod
    def opened(self) -> Model:
        """A new instance of the model. Raises MisuseError."""

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def check(self, world: WorldInfo) -> None:
        self._type = event_type(self._name, world, self._event)
        self._check_inputs(world)

    def joined(self, world: WorldInfo) -> None:
        self.check(world)
        self._dt = world.dt
        self._model = self.opened()

    def show(self, view: View) -> None:
        figures = [node for _, node in walk(view.scene) if isinstance(node, FigureNode)]
        for variable, (symbol, parameter) in self.inputs.items():
            values = [figure.parameters[parameter] for figure in figures if figure.symbol == symbol]
            if len(values) > 1:
                raise MisuseError(
                    f"{self._name}: {len(values)} figures {symbol} in frame {view.frame};"
                    f" {variable} has one value, so only one agent may draw it"
                )
            if values:
                self._values[variable] = values[0]

    def generate(self, tick: Tick) -> Event:
        assert self._model is not None
        for variable, value in self._values.items():
            self._model.set(variable, value)
        self._values.clear()
        self._model.step(tick.frame.number * self._dt, self._dt)
        data = {name: self._model.get(variable) for name, variable in self.outputs.items()}
        return self._type(**data)

    def close(self) -> None:
        if self._model is not None:
            self._model.close()
            self._model = None

    def pairs(self, option: str, text: str) -> Mapping[str, str]:
        """The pairs of "a=b, c=d". Raises MisuseError."""
        pairs = [entry.partition("=") for entry in names_in(text)]
        for name, equals, value in pairs:
            if not (name.strip() and equals and value.strip()):
                raise MisuseError(
                    f"{self._name}: {option} is {text!r}; expected NAME=VALUE, comma-separated"
                )
        return {name.strip(): value.strip() for name, _, value in pairs}

    def _check_inputs(self, world: WorldInfo) -> None:
        """Raise MisuseError for an input from a primitive or a parameter that does not exist."""
        primitives = world.vocabulary.primitives
        for symbol, parameter in self.inputs.values():
            known = [*primitives]
            if symbol not in primitives:
                near = nearest(symbol, known)
                raise MisuseError(f"{self._name}: the world has no primitive {symbol}{near}")
            names = primitives[symbol].fields.names
            if parameter not in names:
                near = nearest(parameter, [*names])
                raise MisuseError(f"{self._name}: {symbol} has no {parameter}{near}")

    def _parameter(self, source: str) -> tuple[str, str]:
        symbol, _, parameter = source.partition(".")
        if not parameter:
            raise MisuseError(f"{self._name}: an input is {source!r}; expected PRIMITIVE.PARAMETER")
        return symbol, parameter

    def number(self, name: str, text: str) -> float:
        """The number of a pair. Raises MisuseError."""
        try:
            number = float(text)
        except ValueError:
            number = float("nan")
        if not isfinite(number):
            raise MisuseError(f"{self._name}: the value of {name} is {text!r}; expected a number")
        return number


__all__ = ["Model", "SteppedModel"]
