"""The service `fmu`: a model of FMI 2 or 3 that takes part in a world."""

from __future__ import annotations

from pathlib import Path

from minerva_bus.errors import MisuseError
from minerva_services.bridging.stepped_model import Model, SteppedModel
from minerva_services.options import require


class Fmu(SteppedModel):
    """Steps an FMU by one frame per frame, and sends its outputs as an event.

    Args:
        path: the FMU, for co-simulation of FMI 2 or 3.
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
        super().__init__("fmu", event, outputs, inputs, draws, starts)
        self._path = Path(path)

    def opened(self) -> Model:
        # Imported here because FMPy takes long to load.
        from minerva_cosimulation.fmu_service.model import FmuModel

        model = FmuModel(self._path, self.starts)
        try:
            for variable in (*self.outputs.values(), *self.inputs):
                model.check(variable)
        except MisuseError:
            model.close()
            raise
        return model
