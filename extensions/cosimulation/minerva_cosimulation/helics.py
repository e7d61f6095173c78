"""A world as a federate of HELICS, which controls the time.

    house = WorldFederate("house.toml", "house.json", seed=7)
    print(house.run(until=100))

The interfaces: https://docs.helics.org/en/latest/user-guide/fundamental_topics/value_federates.html
and https://docs.helics.org/en/latest/user-guide/fundamental_topics/message_federates.html
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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

_MESSAGE: Final = {"text": "text", "source": "text", "destination": "text", "time": "real"}
"""Data that the event type of messages may have, with the kinds of their types."""


@dataclass(frozen=True)
class _Endpoint:
    """An endpoint, and the names of the events that it receives and sends; "": none."""

    of_helics: helics.HelicsEndpoint
    receives: str
    sends: str

    @property
    def name(self) -> str:
        return self.of_helics.name


class WorldFederate:
    """Steps a world as a federate with values and messages; HELICS grants the time of each step.

    The publications of the configuration are outputs of the world and have their names, such as
    `room.celsius`; its inputs have the names of inputs, such as `room.eHeat.watts`. An endpoint has
    tags: a message that it gets is an event of the type that it `receives`, such as `room.eAsk`,
    and events of the type that it `sends` are its messages. A step takes the `period` of the
    configuration, in seconds of HELICS, or 1 s; the first one ends at its `offset` and a period.
    At the time of a step the world gets the values and messages that were sent before this time,
    runs the frames of the step, and publishes its outputs; those of time 0 are of the initial
    string.

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
        self._period, self._offset = _times(self._config)
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
            federate = _awaited(helics.helicsCreateCombinationFederateFromConfig, str(self._config))
            try:
                self._take_part(federate, until)
            finally:
                _awaited(federate.disconnect)
            return self.digest
        except helics.HelicsException as error:
            raise MisuseError(f"helics: {self._config}: {str(error)[:300]}") from None
        finally:
            self._world.close()

    def _take_part(self, federate: helics.HelicsCombinationFederate, until: float) -> None:
        # Which messages arrive in an earlier step would depend on the order of processes.
        helics.helicsFederateSetFlagOption(federate, helics.HELICS_FLAG_UNINTERRUPTIBLE, True)
        outputs, inputs = self._outputs(federate), self._inputs(federate)
        endpoints = self._endpoints(federate)
        _awaited(federate.enter_executing_mode)
        self._publish(outputs)
        steps = 1
        # Multiplied, because a sum of periods would drift from HELICS's own times.
        while (time := self._offset + steps * self._period) <= until:
            granted = _awaited(federate.request_time, time)
            if abs(granted - time) > _LEAST_PERIOD:
                raise MisuseError(
                    f"helics: {self._config}: HELICS granted {granted:g} s in place of {time:g} s:"
                    " the federation has ended, or the configuration limits the times by more than"
                    " `period` and `offset`"
                )
            for name, (source, read) in inputs.items():
                if source.is_updated():
                    self._world.set(name, read(source))
            for endpoint in endpoints:
                self._receive(endpoint)
            for _ in range(self._frames):
                self._world.step()
                for endpoint in endpoints:
                    self._send(endpoint)
            self._publish(outputs)
            steps += 1

    def _endpoints(self, federate: helics.HelicsCombinationFederate) -> Sequence[_Endpoint]:
        """The endpoints, sorted by name, with the event types of their tags."""
        endpoints: list[_Endpoint] = []
        for place in range(federate.n_endpoints):
            endpoint = federate.get_endpoint_by_index(place)
            names = [helics.helicsEndpointGetTag(endpoint, tag) for tag in ("receives", "sends")]
            if not any(names):
                raise MisuseError(
                    f"helics: {self._config}: the endpoint {endpoint.name} needs a tag: the name of"
                    ' the events that it "receives", that it "sends", or both'
                )
            for name in filter(None, names):
                self._check_messages(endpoint.name, name)
            endpoints.append(_Endpoint(endpoint, *names))
        return sorted(endpoints, key=lambda endpoint: endpoint.name)

    def _check_messages(self, endpoint: str, name: str) -> None:
        """Raise MisuseError if events of this name cannot be messages."""
        kinds = {field.name: field.type.kind for field in self._world.event_type(name).fields.all}
        if "text" not in kinds or not kinds.items() <= _MESSAGE.items():
            raise MisuseError(
                f"helics: {self._config}: the endpoint {endpoint}: {name} has the data"
                f" {', '.join(kinds) or 'none'}; an event type of messages has a `text`, and"
                " may have a `source`, a `destination` (texts) and a `time` (a real number)"
            )

    def _receive(self, endpoint: _Endpoint) -> None:
        """Publish the messages of an endpoint as events of the next step, by time and source."""
        own = endpoint.of_helics
        messages = [own.get_message() for _ in range(own.n_pending_messages)]
        for message in sorted(messages, key=lambda each: (each.time, each.original_source)):
            place = f"helics: a message from {message.original_source} to {endpoint.name}"
            if not endpoint.receives:
                raise MisuseError(f'{place}: the endpoint has no tag "receives"')
            try:
                text = message.raw_data.decode()
            except UnicodeDecodeError:
                raise MisuseError(f"{place} is not text in UTF-8") from None
            data = {
                "text": text,
                "source": message.original_source,
                "destination": message.original_destination,
                "time": message.time,
            }
            names = self._world.event_type(endpoint.receives).fields.names
            self._world.publish(endpoint.receives, **{name: data[name] for name in names})

    def _send(self, endpoint: _Endpoint) -> None:
        """Send the events of the last frame that are messages of an endpoint."""
        for event in self._world.sent(endpoint.sends):
            data: dict[str, Any] = dict(zip(event.names, event.values, strict=True))
            to = data.get("destination") or endpoint.of_helics.default_destination
            if not to:
                raise MisuseError(
                    f"helics: {event.sender} sends {event.type} without a destination, and the"
                    f" endpoint {endpoint.name} has none"
                )
            endpoint.of_helics.send_data(data["text"].encode(), to)

    def _outputs(
        self, federate: helics.HelicsCombinationFederate
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
        self, federate: helics.HelicsCombinationFederate
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


def _local(federate: helics.HelicsCombinationFederate, name: str) -> str:
    """A name without the federate's own, which HELICS puts before names that are not global."""
    return name.removeprefix(f"{federate.name}/")


def _times(config: Path) -> tuple[float, float]:
    """The period and the offset of a configuration, in seconds. Raises MisuseError."""
    try:
        plain: Any = json.loads(read_text(config))
    except OSError as error:
        raise MisuseError(f"helics: cannot read {config}: {error.strerror}") from None
    except ValueError as error:
        raise MisuseError(f"helics: {config} is not JSON: {error}") from None
    given = cast("Mapping[str, Any]", plain) if isinstance(plain, dict) else {"period": None}
    times: list[float] = []
    for name, default, least in (("period", _PERIOD, _LEAST_PERIOD), ("offset", 0.0, 0.0)):
        time = given.get(name, default)
        if not isinstance(time, int | float) or not time >= least:
            raise MisuseError(
                f"helics: {config} must be an object, with its `{name}` as a number of seconds"
            )
        times.append(float(time))
    return times[0], times[1]


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
