"""A world within an FMU: what its importer calls; `export_fmu` writes FMUs."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from pythonfmu3 import (  # pyright: ignore[reportMissingTypeStubs]
    Boolean,
    DefaultExperiment,
    Float64,
    Fmi3Causality,
    Fmi3Initial,
    Fmi3Slave,
    Fmi3Status,
    Fmi3Variability,
    Int64,
    String,
)
from pythonfmu3.fmi3slave import Fmi3StepResult  # pyright: ignore[reportMissingTypeStubs]

from minerva_bus.errors import MinervaError, MisuseError
from minerva_cosimulation.stepped_world import SteppedWorld

DESCRIPTION: Final = "minerva.json"
"""The file in the FMU's resources that names the world and its variables."""
DIGEST: Final = "digest"
STARTS: Final = {"Float64": 0.0, "Int64": 0, "Boolean": False, "String": ""}
"""Values of inputs without a default, by type."""
_TYPES: Final[dict[str, Any]] = {
    "Float64": Float64,
    "Int64": Int64,
    "Boolean": Boolean,
    "String": String,
}
_EXACT: Final = 1e-9
"""Tolerated difference between a step and a number of frames, relative to the step."""


class WorldSlave(Fmi3Slave):
    """A world that an importer steps; it starts when the initialization mode ends.

    No method raises: an exception would be the status fatal, after which importers that free the
    FMU corrupt the memory of their process. Instead, a failure is a message of the FMU's log and
    the status error of this and all later steps. Getters and setters do not use the world, hence
    cannot fail.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)  # pyright: ignore[reportUnknownMemberType]
        self._folder = Path(arguments["resources"])
        self._description: dict[str, Any] = json.loads(
            (self._folder / DESCRIPTION).read_text(encoding="utf-8")
        )
        self._world: SteppedWorld | None = None
        self._due: set[str] = set()
        self.time = 0.0
        self.default_experiment = DefaultExperiment(step_size=self._description["dt"])
        self._register("time", "Float64", Fmi3Causality.independent, lambda: self.time)
        self._variables: list[dict[str, Any]] = self._description["variables"]
        self._values: dict[str, Any] = {
            variable["name"]: variable["start"] for variable in self._variables
        }
        self._values[DIGEST] = ""
        for variable in self._variables:
            self._register_described(**variable)
        self._register(DIGEST, "String", Fmi3Causality.output, partial(self._get, DIGEST))

    def exit_initialization_mode(self) -> None:
        """Start the world, and read its outputs."""
        described = self._description
        world: str = described["world"]
        try:
            self._world = SteppedWorld(
                str(self._folder / world) if described["bundled"] else world,
                described["seed"],
                **described["options"],
            )
            self._read(self._world)
        except Exception as error:
            self._fail(error)

    def do_step(self, current_time: float, step_size: float) -> Fmi3StepResult:
        """Run the frames of a step of simulated time, in seconds."""
        try:
            if self._world is None:
                raise MisuseError("the world has not started, or has failed; see the FMU's log")
            frames = self._frames(step_size)
            self._send(self._world)
            self._world.step(frames)
            self._read(self._world)
        except Exception as error:
            self._fail(error)
            return Fmi3StepResult(Fmi3Status.error)
        self.time = current_time + step_size
        return Fmi3StepResult()

    def terminate(self) -> None:
        """End the world."""
        world, self._world = self._world, None
        if world is not None:
            world.close()

    def _frames(self, step_size: float) -> int:
        dt = self._description["dt"]
        frames = round(step_size / dt)
        if frames < 1 or abs(step_size - frames * dt) > _EXACT * step_size:
            raise MisuseError(
                f"a step of {step_size:g} s; expected a multiple of a frame, {dt:g} s"
            )
        return frames

    def _send(self, world: SteppedWorld) -> None:
        """Set all inputs of the events of which a datum was set."""
        for variable in self._variables:
            name = variable["name"]
            if variable["causality"] == "input" and _event(name) in self._due:
                world.set(name, self._values[name])
        self._due.clear()

    def _read(self, world: SteppedWorld) -> None:
        """Read all outputs, so that getters need no world."""
        for variable in self._variables:
            if variable["causality"] == "output":
                self._values[variable["name"]] = world.get(variable["name"])
        self._values[DIGEST] = world.digest

    def _fail(self, error: Exception) -> None:
        kind = "" if isinstance(error, MinervaError) else f"{type(error).__name__}: "
        self.log(f"fmu: {kind}{error}", Fmi3Status.error)
        self.terminate()

    def _get(self, name: str) -> Any:
        return self._values[name]

    def _put(self, name: str, value: Any) -> None:
        self._values[name] = value
        self._due.add(_event(name))

    def _register_described(self, name: str, type: str, causality: str, start: Any) -> None:
        if causality == "input":
            put = partial(self._put, name)
            self._register(
                name, type, Fmi3Causality.input, partial(self._get, name), put, start=start
            )
        else:
            self._register(name, type, Fmi3Causality.output, partial(self._get, name))

    def _register(
        self,
        name: str,
        kind: str,
        causality: Any,
        getter: Callable[[], Any],
        setter: Callable[[Any], None] | None = None,
        **further: Any,
    ) -> None:
        if causality is Fmi3Causality.output:
            # Otherwise the description would contain a start value, which only the world has.
            further["initial"] = Fmi3Initial.calculated
        continuous = kind == "Float64"
        self.register_variable(
            _TYPES[kind](
                name,
                causality=causality,
                variability=Fmi3Variability.continuous if continuous else Fmi3Variability.discrete,
                getter=getter,
                setter=setter,
                **further,
            ),
            nested=False,
        )


def _event(name: str) -> str:
    """The event type of an input, with its receiver if it has one."""
    return name.rpartition(".")[0]
