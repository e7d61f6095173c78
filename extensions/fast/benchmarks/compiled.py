"""Time of a frame with a compiled method, its form for populations, and agent by agent.

    python -m extensions.fast.benchmarks.compiled
        [--agents N ...] [--turns 5] [--plain-agents 10000] [--json]

Sheep of docs/populations.md walk, eat, die and give birth; `still` is the same without births and
deaths. Each turn computes a frame of each form, one after another, from the same string. `ratio`
is the CPU time of a form divided by that of the form for populations in the same turn; compare
these, because milliseconds depend on the machine. All forms give the same string, which is checked.
Above `--plain-agents` agents the slow form is left out. Compilation is not in the times; `first` is
the time of the first frame, in which the machine code is read or compiled.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from benchmarks.command import Table, options
from minerva_bus import (
    EMPTY,
    Agent,
    EventType,
    Metres,
    Scene,
    evolve,
    on,
)
from minerva_bus.world.context import Frame

eDay = EventType("eDay", grass=float)
eRest = EventType("eRest")
LIMIT: Final = 8.0
FORMS: Final = ("agent by agent", "population", "compiled")
COLUMNS: Final = {"model": "<6", "agents": ">9,", "form": "<15", "ms": ">9.2f", "ratio": ">8.2f",
                  "first ms": ">9.0f"}  # fmt: skip


def one_agent(compiled: bool) -> type[Agent]:
    """Sheep whose methods are for one agent."""

    class Sheep(Agent, symbol="ASheep"):
        x: Metres = 0.0
        y: Metres = 0.0
        energy: float = 5.0
        births: int = 0

        @on("eDay", compiled=compiled)
        def live(self, day: Any, moment: Any) -> Scene | None:
            self.x += moment.chance.normal(0, 0.5)
            self.y += moment.chance.normal(0, 0.5)
            self.energy += day.grass * moment.chance.random() - 1
            if self.energy < 0:
                return EMPTY
            if self.energy > LIMIT:
                self.energy /= 2
                return self.string + self.child(x=self.x, y=self.y, energy=self.energy)
            return None

        @on("eRest", compiled=compiled)
        def rest(self, rest: Any, moment: Any) -> None:
            self.x += moment.chance.normal(0, 0.5)
            self.y += moment.chance.normal(0, 0.5)

    return Sheep


def live_together(sheep: Any, day: Any, moment: Any) -> None:
    """A day of all sheep."""
    sheep.x += moment.chance.normal(0, 0.5)
    sheep.y += moment.chance.normal(0, 0.5)
    sheep.energy += day.grass * moment.chance.random() - 1
    sheep.die(sheep.energy < 0)
    fat = sheep.energy > LIMIT
    sheep.energy = np.where(fat, sheep.energy / 2, sheep.energy)
    sheep.bear(fat, x=sheep.x, y=sheep.y, energy=sheep.energy)


class Flock(Agent, symbol="ASheep"):
    """The same for a population."""

    x: Metres = 0.0
    y: Metres = 0.0
    energy: float = 5.0
    births: int = 0

    @on("eDay", population=True)
    def live(self: Any, day: Any, moment: Any) -> None:
        live_together(self, day, moment)

    @on("eRest", population=True)
    def rest(self, rest: Any, moment: Any) -> None:
        self.x += moment.chance.normal(0, 0.5)
        self.y += moment.chance.normal(0, 0.5)


def timed(scene: Scene, event: Any, kind: type[Agent], frame: Frame) -> tuple[float, Scene]:
    """Milliseconds of CPU time of a frame, and its string."""
    began = time.process_time()
    after = evolve(scene, [event], [kind], frame).scene
    return 1000 * (time.process_time() - began), after


def measured(
    event: Any, kinds: dict[str, type[Agent]], count: int, turns: int
) -> dict[str, list[float]]:
    """Milliseconds of each form in each frame; the first frame is a warm-up."""
    rng = np.random.default_rng(1)
    scene = Flock.many("s", count, x=rng.uniform(0, 30, count), y=0.0)
    times: dict[str, list[float]] = {form: [] for form in kinds}
    for number in range(turns + 1):
        strings = dict[str, Scene]()
        for form, kind in kinds.items():
            spent, strings[form] = timed(scene, event, kind, Frame(number, 0.1, 7))
            times[form].append(spent)
        scene = strings["population"]
        assert all(string.digest == scene.digest for string in strings.values())
    return times


def main(words: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = options(__doc__, words, agents=[10_000, 100_000], turns=5, plain_agents=10_000)
    table = Table(COLUMNS, as_json=chosen.json)
    classes = dict(zip(FORMS, (one_agent(False), Flock, one_agent(True)), strict=True))
    for model, event in (("sheep", eDay(grass=2.0)), ("still", eRest())):
        for count in chosen.agents:
            kinds = {
                form: kind
                for form, kind in classes.items()
                if form != FORMS[0] or count <= chosen.plain_agents
            }
            times = measured(event, kinds, count, chosen.turns)
            for form, (first, *spent) in times.items():
                ratios = [
                    own / base for own, base in zip(spent, times["population"][1:], strict=True)
                ]
                table.row(
                    {
                        "model": model,
                        "agents": count,
                        "form": form,
                        "ms": statistics.median(spent),
                        "ratio": statistics.median(ratios),
                        "first": first,
                    }
                )


if __name__ == "__main__":
    main()
