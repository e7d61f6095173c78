"""A world as a simulator of mosaik, which controls the time.

    SIMULATORS = {"Minerva": {"python": "minerva_cosimulation.mosaik:MinervaSimulator"}}
    scenario = mosaik.World(SIMULATORS)
    house = scenario.start("Minerva", world="house.toml", seed=7).World()
    scenario.connect(controller, house, ("power", "eHeat.watts"))

The interface: https://mosaik.readthedocs.io/en/latest/mosaik-api/high-level.html
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import mosaik_api_v3

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.vocabulary import AgentKind, Vocabulary
from minerva_cosimulation.stepped_world import SteppedWorld

WORLD: Final = "World"
"""The model, and the id of its only entity; the agents are its children."""
_META: Final[dict[str, Any]] = {"api_version": "3.0", "type": "time-based", "models": {}}


class MinervaSimulator(mosaik_api_v3.Simulator):
    """Steps a world; its entities are the world and the agents of its initial string.

    Parameters of `mosaik.World.start`: `world`, a world file or the name of an installed world;
    `seed`; `frames`, the number of frames of a step, and `duration`, its duration in units of
    mosaik's time; all others are options of the world. `digest` of the simulator is that of the
    world.
    """

    def __init__(self) -> None:
        super().__init__(_META)
        self._world: SteppedWorld | None = None
        self._frames, self._duration = 1, 1
        self._made = False

    def init(
        self,
        sid: str,
        time_resolution: float = 1.0,
        *,
        world: Any = "",
        seed: int | None = None,
        frames: int = 1,
        duration: int = 1,
        **options: Any,
    ) -> Any:
        """Start the world, and describe its agents. Raises MinervaError."""
        for name, value in (("frames", frames), ("duration", duration)):
            if value < 1:
                raise MisuseError(f"mosaik: {name} is {value}; expected a whole number from 1")
        self._frames, self._duration = frames, duration
        self._world = SteppedWorld(world, seed, **options)
        return {**_META, "models": _models(self._world.vocabulary)}

    def create(self, num: int, model: str, **parameters: Any) -> Any:
        """The only entity `World`, with the agents as its children. Raises MisuseError."""
        if num != 1 or self._made or model != WORLD:
            raise MisuseError(f"mosaik: a simulator has one {WORLD}; start another simulator")
        self._made = True
        children = [
            {"eid": agent.id, "type": agent.symbol} for agent in self._stepped.agents.values()
        ]
        return [{"eid": WORLD, "type": WORLD, "children": children}]

    def step(self, time: int, inputs: Mapping[str, Any], max_advance: int) -> int:
        """Send the inputs as events, and run the frames of a step. Raises MinervaError."""
        for entity in sorted(inputs):
            for name, values in sorted(inputs[entity].items()):
                if len(values) > 1:
                    raise MisuseError(
                        f"mosaik: {entity} has {len(values)} connections to {name}:"
                        f" {', '.join(sorted(values))}; an event has one value for each datum"
                    )
                path = name if entity == WORLD else f"{entity}.{name}"
                self._stepped.set(path, next(iter(values.values())))
        self._stepped.step(self._frames)
        return time + self._duration

    def get_data(self, outputs: Mapping[str, list[str]]) -> dict[str, dict[str, Any]]:
        """The attributes of agents after the step. Raises MisuseError for dead agents."""
        return {
            agent: {name: self._stepped.get(f"{agent}.{name}") for name in names}
            for agent, names in outputs.items()
        }

    def finalize(self) -> None:
        """End the world."""
        if self._world is not None:
            self._world.close()

    @property
    def digest(self) -> str:
        """The digest of the string, in hexadecimal."""
        return self._stepped.digest

    @property
    def _stepped(self) -> SteppedWorld:
        if self._world is None:
            raise MisuseError("mosaik: the simulator has not been initialized")
        return self._world


def _models(vocabulary: Vocabulary) -> dict[str, dict[str, Any]]:
    """The model of the world, and one for each kind of agents."""
    inputs = {
        name: [f"{name}.{datum}" for datum in event.fields.names]
        for name, event in vocabulary.events.items()
        if not event.visual
    }
    models = {WORLD: _model(True, [path for paths in inputs.values() for path in paths])}
    for name, kind in vocabulary.kinds.items():
        models[name] = _model(False, [*kind.fields.names, *_received(kind, inputs)])
    return models


def _received(kind: AgentKind, inputs: Mapping[str, list[str]]) -> list[str]:
    return [path for event in sorted(kind.subscribes) for path in inputs.get(event, [])]


def _model(public: bool, attributes: list[str]) -> dict[str, Any]:
    return {"public": public, "params": [], "attrs": attributes}
