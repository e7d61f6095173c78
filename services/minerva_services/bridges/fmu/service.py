"""The service `fmu`: a model of FMI 3 that takes part in a world."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import FigureNode, walk
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.event_factory import event_type
from minerva_services.options import names_in, require

if TYPE_CHECKING:
    from minerva_services.bridges.fmu.model import FmuModel


class Fmu(Device, Generator, coupled=True):
    """Steps an FMU by one frame per frame, and sends its outputs as an event.

    Args:
        path: the FMU, for co-simulation of FMI 3.
        event: the event type of its outputs, sent in each frame.
        outputs: the variable of each datum of this event: "celsius=room.T, ...".
        inputs: the parameter of a primitive for each variable: "heat=PHeater.watts, ...". Exactly
            one figure of this primitive must be in the view; without one, the variable keeps its
            value.
        draws: the visual event types whose views contain these figures, comma-separated.
        starts: start values of variables: "capacity=2000, ...".

    Raises MisuseError if FMPy is not installed and for invalid options.

    """

    def __init__(
        self,
        path: str,
        event: str,
        outputs: str,
        inputs: str = "",
        draws: str = "",
        starts: str = "",
    ) -> None:
        require("fmu", "fmpy", "FMPy", "fmi")
        self._event = event
        self.draws = names_in(draws)
        # A view belongs to each frame, because the FMU is stepped in each.
        self.every = 1 if self.draws else 0
        self._path = Path(path)
        self._outputs = _pairs("outputs", outputs)
        self._inputs = {
            variable: _parameter(source) for variable, source in _pairs("inputs", inputs).items()
        }
        self._starts = {
            name: _number(name, text) for name, text in _pairs("starts", starts).items()
        }
        if self._inputs and not self.draws:
            raise MisuseError("fmu: inputs need draws, the visual event type of their figures")
        self._values: dict[str, Any] = {}
        self._model: FmuModel | None = None

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def joined(self, world: WorldInfo) -> None:
        # Imported here because FMPy takes long to load.
        from minerva_services.bridges.fmu.model import FmuModel

        self._type = event_type("fmu", world, self._event)
        self._dt = world.dt
        self._model = model = FmuModel(self._path, self._starts)
        for variable in (*self._outputs.values(), *self._inputs):
            model.check(variable)

    def show(self, view: View) -> None:
        figures = [node for _, node in walk(view.scene) if isinstance(node, FigureNode)]
        for variable, (symbol, parameter) in self._inputs.items():
            values = [figure.parameters[parameter] for figure in figures if figure.symbol == symbol]
            if len(values) > 1:
                raise MisuseError(
                    f"fmu: {len(values)} figures {symbol} in frame {view.frame}; {variable} has one"
                    " value, so only one agent may draw it"
                )
            if values:
                self._values[variable] = values[0]

    def generate(self, tick: Tick) -> Event:
        assert self._model is not None
        for variable, value in self._values.items():
            self._model.set(variable, value)
        self._values.clear()
        self._model.step(tick.frame.number * self._dt, self._dt)
        data = {name: self._model.get(variable) for name, variable in self._outputs.items()}
        return self._type(**data)

    def close(self) -> None:
        if self._model is not None:
            self._model.close()
            self._model = None


def _pairs(option: str, text: str) -> Mapping[str, str]:
    """The pairs of "a=b, c=d". Raises MisuseError."""
    pairs = [entry.partition("=") for entry in names_in(text)]
    for name, equals, value in pairs:
        if not (name.strip() and equals and value.strip()):
            raise MisuseError(f"fmu: {option} is {text!r}; expected NAME=VALUE, comma-separated")
    return {name.strip(): value.strip() for name, _, value in pairs}


def _parameter(source: str) -> tuple[str, str]:
    symbol, _, parameter = source.partition(".")
    if not parameter:
        raise MisuseError(f"fmu: an input is {source!r}; expected PRIMITIVE.PARAMETER")
    return symbol, parameter


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise MisuseError(
            f"fmu: the start value of {name} is {text!r}; expected a number"
        ) from None
