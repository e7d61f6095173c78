"""The service `mosaik`: a simulator of mosaik that takes part in a world."""

from __future__ import annotations

import threading

from minerva_bus.errors import MisuseError
from minerva_services.bridging.stepped_model import Model, SteppedModel
from minerva_services.options import require


class Mosaik(SteppedModel):
    """Runs a simulator in a scenario of mosaik, and sends its outputs as an event.

    Args:
        simulator: its class, "module:Class", or the command that starts it, with "%(addr)s" for
            mosaik's address.
        model: the model of its only entity.
        event: the event type of its outputs, sent in each frame.
        outputs: the attribute of each datum of this event: "celsius=celsius, ...".
        inputs: the parameter of a primitive for each attribute: "watts=PHeater.watts, ...". Exactly
            one figure of this primitive must be in the view; without one, the attribute keeps its
            value.
        draws: the visual event types whose views contain these figures, comma-separated.
        starts: values of inputs before the first figure: "watts=500, ..."; default 0.
        settings: numbers for the simulator's `init`: "step_size=60, ...".
        parameters: numbers for the model: "capacity=2000, ...".
        duration: the duration of a frame in units of mosaik's time.
        seconds: of wall time that the simulator may take for a frame.

    Raises MisuseError if mosaik is not installed and for invalid options.

    """

    def __init__(
        self,
        simulator: str,
        model: str,
        event: str,
        outputs: str,
        inputs: str = "",
        draws: str = "",
        starts: str = "",
        settings: str = "",
        parameters: str = "",
        duration: int = 1,
        seconds: float = 60.0,
    ) -> None:
        require("mosaik", "mosaik", "mosaik", "mosaik")
        super().__init__("mosaik", event, outputs, inputs, draws, starts)
        if duration < 1:
            raise MisuseError(f"mosaik: duration is {duration}; expected a whole number from 1")
        if not 0 < seconds <= threading.TIMEOUT_MAX:
            raise MisuseError(f"mosaik: seconds is {seconds}; expected a number above 0")
        self._simulator, self._entity, self._duration = simulator, model, duration
        self._seconds = seconds
        self._settings = self._numbers("settings", settings)
        self._parameters = self._numbers("parameters", parameters)

    def opened(self) -> Model:
        # Imported here because mosaik takes long to load.
        from minerva_cosimulation.mosaik_service.scenario import Scenario

        return Scenario(
            self._simulator,
            self._entity,
            settings=self._settings,
            parameters=self._parameters,
            inputs={name: self.starts.get(name, 0.0) for name in self.inputs},
            outputs=tuple(self.outputs.values()),
            duration=self._duration,
            seconds=self._seconds,
        )

    def _numbers(self, option: str, text: str) -> dict[str, float]:
        """Whole numbers stay whole, because mosaik's times are."""
        pairs = self.pairs(option, text)
        numbers = {name: self.number(name, value) for name, value in pairs.items()}
        return {name: int(n) if n.is_integer() else n for name, n in numbers.items()}
