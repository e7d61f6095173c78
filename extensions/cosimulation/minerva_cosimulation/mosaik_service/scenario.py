"""A scenario of mosaik with one simulator and the world: https://mosaik.readthedocs.io.

mosaik runs in a thread and controls when the simulator steps. The world is a simulator of the
scenario as well: its step waits until the world's next frame.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Mapping
from queue import Empty, SimpleQueue
from typing import Any, Final

import mosaik
import mosaik_api_v3

from minerva_bus.errors import MisuseError

_LINK: Final = "World"
_FOREVER: Final = 1 << 62
_START_SECONDS: Final = 60.0
"""Seconds that a simulator may take to start."""
_END_SECONDS: Final = 1.5
"""Seconds to wait for the end of mosaik, which ends the simulator's process."""
_CONNECTIONS: Final = ("handle remote requests", "Reader task")
"""Starts of the names of tasks that mosaik needs to end a simulator's process."""
_Values = dict[str, Any]


class _EndedError(Exception):
    """The world has ended, hence the scenario."""


class FrameValues:
    """Values between the world's frames and mosaik's thread."""

    def __init__(self, inputs: Mapping[str, float]) -> None:
        self.inputs: SimpleQueue[_Values | None] = SimpleQueue()
        self.outputs: SimpleQueue[_Values | Exception] = SimpleQueue()
        self.names = list(inputs)

    def await_frame(self) -> _Values:
        """The inputs of the next frame. Raises _EndedError."""
        values = self.inputs.get()
        if values is None:
            raise _EndedError
        return values


class WorldSimulator(mosaik_api_v3.Simulator):
    """The world in the scenario: its outputs are the simulator's inputs."""

    def __init__(self) -> None:
        super().__init__({"api_version": "3.0", "type": "time-based", "models": {}})

    def init(
        self, sid: str, time_resolution: float = 1.0, **settings: Any
    ) -> mosaik_api_v3.types.Meta:
        """Take the exchange with the world, and the duration of its frames."""
        self._exchange: FrameValues = settings["exchange"]
        self._duration: int = settings["duration"]
        attributes = [*self._exchange.names, *settings["outputs"]]
        model: Any = {"public": True, "params": [], "attrs": sorted(set(attributes))}
        meta: Any = {"api_version": "3.0", "type": "time-based", "models": {_LINK: model}}
        return meta

    def create(self, num: int, model: str, **parameters: Any) -> Any:
        """The only entity."""
        return [{"eid": _LINK, "type": _LINK}]

    def step(self, time: int, inputs: Mapping[str, Any], max_advance: int) -> int:
        """Give the world the outputs of the last frame, and await the inputs of the next."""
        received = inputs.get(_LINK, {})
        self._exchange.outputs.put(
            {name: next(iter(values.values())) for name, values in received.items()}
        )
        self._values = self._exchange.await_frame()
        return time + self._duration

    def get_data(self, outputs: Mapping[str, list[str]]) -> Any:
        """The inputs of the frame."""
        return {
            entity: {name: self._values[name] for name in outputs[entity]} for entity in outputs
        }


class Scenario:
    """The simulator and the world in a scenario that runs as long as the world.

    Args:
        simulator: a class, "module:Class", or a command with "%(addr)s".
        model: the model of the only entity.
        settings: arguments of the simulator's `init`.
        parameters: of the model.
        inputs: the attributes that the world sets, with their first values.
        outputs: the attributes that the world reads.
        duration: of a frame, in units of mosaik's time.
        seconds: of wall time that the simulator may take for a frame.

    Raises MisuseError if the scenario cannot start.

    """

    def __init__(
        self,
        simulator: str,
        model: str,
        *,
        settings: Mapping[str, float],
        parameters: Mapping[str, float],
        inputs: Mapping[str, float],
        outputs: tuple[str, ...],
        duration: int,
        seconds: float,
    ) -> None:
        self._kind = "cmd" if "%(addr)s" in simulator else "python"
        self._simulator, self._model, self._duration = simulator, model, duration
        self._seconds, self._loop = seconds, asyncio.new_event_loop()
        self._waiting = False
        self._settings, self._parameters, self._names = settings, parameters, outputs
        self._inputs, self._outputs = dict(inputs), _Values()
        self._exchange = FrameValues(inputs)
        self._thread = threading.Thread(target=self._work, name="mosaik", daemon=True)
        self._thread.start()
        try:
            self._await_outputs("starting", _START_SECONDS)
        except BaseException:
            self.close()
            raise

    def set(self, name: str, value: Any) -> None:
        """Set an input for the next step."""
        self._inputs[name] = value

    def get(self, name: str) -> Any:
        """The value of an output after the last step. Raises MisuseError if there is none."""
        if name not in self._outputs:
            raise MisuseError(f"mosaik: {self._simulator}: {self._model} has sent no {name!r}")
        return self._outputs[name]

    def step(self, time: float, duration: float) -> None:
        """Let mosaik run one frame. Raises MisuseError if the scenario fails or takes too long."""
        self._exchange.inputs.put(dict(self._inputs))
        self._outputs = self._await_outputs(f"the step at time {time:g} s", self._seconds)

    def close(self) -> None:
        """End the scenario and its simulator, also one that does not answer."""
        if self._waiting:
            self._loop.call_soon_threadsafe(self._cancel)
        else:
            self._exchange.inputs.put(None)
        self._thread.join(_END_SECONDS)

    def _await_outputs(self, what: str, seconds: float) -> _Values:
        self._waiting = True
        try:
            outputs = self._exchange.outputs.get(timeout=seconds)
        except Empty:
            raise MisuseError(
                f"mosaik: {self._simulator}: {what} takes more than {seconds:g} s of wall time"
            ) from None
        self._waiting = False
        if isinstance(outputs, Exception):
            raise MisuseError(f"mosaik: {self._simulator}: {_one_line(outputs)}")
        return outputs

    def _work(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._run()
        except (_EndedError, asyncio.CancelledError):
            pass
        except BaseException as error:  # mosaik also raises SystemExit
            reason = error if isinstance(error, Exception) else RuntimeError("it has ended")
            self._exchange.outputs.put(reason)

    def _run(self) -> None:
        programs: Any = {
            "Simulator": {self._kind: self._simulator},
            _LINK: {"python": f"{__name__}:WorldSimulator"},
        }
        with mosaik.World(
            programs,
            # The cache of mosaik 3.6 drops the last outputs before a time-shifted input reads them.
            cache=False,
            mosaik_config={"start_timeout": _START_SECONDS},
            skip_greetings=True,
            configure_logging=False,
            asyncio_loop=self._loop,
        ) as world:
            try:
                self._connect(world)
                world.run(until=_FOREVER, print_progress=False)
            finally:
                # mosaik leaves the other simulator's task pending when one fails.
                steps = self._cancel()
                self._loop.run_until_complete(asyncio.gather(*steps, return_exceptions=True))

    def _connect(self, world: mosaik.World) -> None:
        settings: dict[str, Any] = {**self._settings}
        entity = getattr(world.start("Simulator", **settings), self._model)(**self._parameters)
        link: Any = world.start(
            _LINK, exchange=self._exchange, duration=self._duration, outputs=self._names
        ).World()
        if self._inputs:
            world.connect(link, entity, *self._inputs)
        # Later by one unit of time, because otherwise each would wait for the other.
        first = dict.fromkeys(self._names)
        world.connect(entity, link, *self._names, time_shifted=True, initial_data=first)

    def _cancel(self) -> list[asyncio.Task[Any]]:
        """Cancel the steps of all simulators; mosaik's connections remain until it closes them."""
        steps = [
            task
            for task in asyncio.all_tasks(self._loop)
            if not task.get_name().startswith(_CONNECTIONS)
        ]
        for task in steps:
            task.cancel()
        return steps


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
