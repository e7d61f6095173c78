"""A world as a federate of HELICS, which controls the time.

    house = WorldFederate("house.toml", "house.json", seed=7)
    print(house.run(until=100))

The interface: https://docs.helics.org/en/latest/user-guide/fundamental_topics/value_federates.html
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final, TypeVar, cast

import helics

from minerva_bus.api.world import World
from minerva_bus.errors import MisuseError
from minerva_bus.files import read_text
from minerva_cosimulation.stepped_world import SteppedWorld

_Result = TypeVar("_Result")
_INTERRUPTED: Final = 130
_PERIOD: Final = 1.0
_LEAST_PERIOD: Final = 1e-9
"""The resolution of HELICS's time."""

_READERS: Final[Mapping[str, Callable[[helics.HelicsInput], Any]]] = {
    "bool": lambda source: source.boolean,
    "int": lambda source: source.integer,
    "real": lambda source: source.double,
    "text": lambda source: source.string,
    "list": lambda source: source.vector,
}
"""How an input of HELICS is read, by the kind of its type."""


class WorldFederate:
    """Steps a world as a value federate; HELICS grants the time of each step.

    The publications of the configuration are outputs of the world and have their names, such as
    `room.celsius`; its inputs have the names of inputs, such as `room.eHeat.watts`. A step takes
    the `period` of the configuration, in seconds of HELICS, or 1 s. At the time of a step the
    world gets the values that were published before this time, runs the frames of the step, and
    publishes its outputs; those of time 0 are of the initial string.

    Args:
        world: a `World`, a world file, or the name of an installed world.
        config: a configuration of a federate, a JSON file of HELICS.
        seed: of all random numbers; default: the world's own.
        frames: the number of frames of a step.
        options: the world's own options.

    Raises MinervaError if the configuration does not fit the world, if the world cannot start, and
    if there is no broker.

    """

    def __init__(
        self,
        world: World | str | Path,
        config: str | Path,
        seed: int | None = None,
        *,
        frames: int = 1,
        **options: Any,
    ) -> None:
        if frames < 1:
            raise MisuseError(f"helics: frames is {frames}; expected a whole number from 1")
        self._config, self._frames = Path(config), frames
        self._period = _period(self._config)
        self._world = SteppedWorld(world, seed, **options)

    @property
    def digest(self) -> str:
        """The digest of the string, in hexadecimal."""
        return self._world.digest

    def run(self, until: float) -> str:
        """Take part from time 0 to this time, in seconds of HELICS, and leave; the last digest.

        Raises MinervaError if the configuration does not fit the world, if there is no broker, and
        if the world or the federation fails.
        """
        try:
            federate = _awaited(helics.helicsCreateValueFederateFromConfig, str(self._config))
            try:
                self._take_part(federate, until)
            finally:
                _awaited(federate.disconnect)
            return self.digest
        except helics.HelicsException as error:
            raise MisuseError(f"helics: {self._config}: {str(error)[:300]}") from None
        finally:
            self._world.close()

    def _take_part(self, federate: helics.HelicsValueFederate, until: float) -> None:
        helics.helicsFederateSetFlagOption(federate, helics.HELICS_FLAG_UNINTERRUPTIBLE, True)
        outputs, inputs = self._outputs(federate), self._inputs(federate)
        _awaited(federate.enter_executing_mode)
        self._publish(outputs)
        steps = 0
        # Multiplied, because a sum of periods would drift from HELICS's own times.
        while (steps + 1) * self._period <= until:
            steps += 1
            _awaited(federate.request_time, steps * self._period)
            for name, (source, read) in inputs.items():
                if source.is_updated():
                    self._world.set(name, read(source))
            self._world.step(self._frames)
            self._publish(outputs)

    def _outputs(
        self, federate: helics.HelicsValueFederate
    ) -> Mapping[str, helics.HelicsPublication]:
        """The publications by the name of the output; each is read once as a check."""
        count = federate.n_publications
        publications = [federate.get_publication_by_index(place) for place in range(count)]
        outputs = {_local(federate, output.name): output for output in publications}
        for name in outputs:
            self._world.get(name)
        return outputs

    def _publish(self, outputs: Mapping[str, helics.HelicsPublication]) -> None:
        for name, output in outputs.items():
            output.publish(self._world.get(name))

    def _inputs(
        self, federate: helics.HelicsValueFederate
    ) -> Mapping[str, tuple[helics.HelicsInput, Callable[[helics.HelicsInput], Any]]]:
        """The inputs by name, sorted, with the function that reads each."""
        sources = [federate.get_subscription_by_index(place) for place in range(federate.n_inputs)]
        inputs = {_local(federate, source.name): source for source in sources}
        return {name: (inputs[name], self._reader(name)) for name in sorted(inputs)}

    def _reader(self, name: str) -> Callable[[helics.HelicsInput], Any]:
        kind = self._world.input_field(name).type
        reader = _READERS.get(kind.kind)
        if reader is None:
            raise MisuseError(f"helics: {name} is {kind}, which HELICS has no values of")
        return reader


def _local(federate: helics.HelicsValueFederate, name: str) -> str:
    """A name without the federate's own, which HELICS puts before names that are not global."""
    return name.removeprefix(f"{federate.name}/")


def _period(config: Path) -> float:
    """The period of a configuration, in seconds. Raises MisuseError."""
    try:
        plain: Any = json.loads(read_text(config))
    except OSError as error:
        raise MisuseError(f"helics: cannot read {config}: {error.strerror}") from None
    except ValueError as error:
        raise MisuseError(f"helics: {config} is not JSON: {error}") from None
    period: Any = cast("Any", plain).get("period", _PERIOD) if isinstance(plain, dict) else None
    if not isinstance(period, int | float) or not period >= _LEAST_PERIOD:
        raise MisuseError(
            f"helics: {config} must be an object, with its `period` as a number of seconds"
        )
    return float(period)


def _awaited(call: Callable[..., _Result], *arguments: Any) -> _Result:
    """The result of a call of HELICS, which Ctrl-C interrupts: HELICS waits without Python."""
    results: SimpleQueue[tuple[_Result] | BaseException] = SimpleQueue()

    def work() -> None:
        try:
            results.put((call(*arguments),))
        except BaseException as error:
            results.put(error)

    threading.Thread(target=work, name="helics", daemon=True).start()
    try:
        result = results.get()
    except KeyboardInterrupt:
        helics.helicsAbort(_INTERRUPTED, "interrupted")
        raise
    if isinstance(result, BaseException):
        raise result
    return result[0]
