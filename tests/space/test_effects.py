"""Spaces whose methods provably change nothing else may be asked for a frame early, or twice."""

import math
from functools import partial

import numpy as np
import pytest

from minerva_bus import EMPTY, Agent, Cells, EventType, Reals, World, each, evolve, on
from minerva_bus.settings.overrides import Overrides
from minerva_bus.space import ORDERED, Column, OnLattice, Space, kernel, rule

eStep = EventType("eStep", size=float)
eTick = EventType("eTick")
LIMIT = 4
NOTES = []
ROWS = np.zeros(3)


class Ant(OnLattice):
    energy: Column


class Counted(OnLattice):
    energy: Column

    @property
    def total(self):
        NOTES.append("total")
        return self.energy.sum()


@rule(ORDERED)
def graze(i: int, ants: Ant, gain: float):
    ants.energy[i] += gain


@kernel
def shout(energy):
    print(energy)


@rule(ORDERED)
def cry(i: int, ants: Ant):
    shout(ants.energy[i])


RULES = (graze,)


def mean(values):
    return float(np.mean(values)) if len(values) else 0.0


def noted(value):
    NOTES.append(value)
    return value


def kept(value, known=[]):  # noqa: B006
    known[0:0] = [value]
    return len(known)


class Meadow(Space, symbol="AMeadow"):
    ants: Reals
    grass: Cells
    mean: float = 0.0
    days: int = 0

    @property
    def energy(self):
        NOTES.append("energy")
        return Ant.read(self.ants).energy

    def count(self, step):
        self.days += 1
        return step

    def unsaid(self, value):
        NOTES.append(value)


def runs(self, step, moment):
    self.run(moment, graze, gain=step.size * moment.dt)
    self.run(moment, *RULES, gain=1)


def sums_up(self, step, moment):
    energy = Ant.read(self.ants).energy
    self.mean = mean(energy[energy > 0])
    for row in range(2):
        self.days += int(energy.sum() > math.sqrt(row)) + int((self.grass == LIMIT).sum())
    hungry: list[int] = [k for k in range(LIMIT) if energy[k] < np.float64(1.5)]
    if len(hungry) > LIMIT and moment.number % 2 == 0:
        return EMPTY
    return None


def draws(self, step, moment):
    self.mean = moment.chance.normal(0, 1)


def writes(self, step, moment):
    grass = self.writable("grass")
    grass[0, 1:] = np.zeros(1, np.int64).astype(np.int16)
    self.count(step.size)


PURE = [runs, sums_up, draws, writes]


def emits(self, step, moment):
    moment.emit(eStep(1.0))


def emits_by_another_name(self, step, moment):
    emit = moment.emit
    emit(eStep(1.0))


def passes_the_moment_on(self, step, moment):
    noted(moment)


def prints(self, step, moment):
    print(self.days)


def notes(self, step, moment):
    noted(self.days)


def changes_a_list(self, step, moment):
    rows = ROWS
    rows[0] = 1


def changes_a_default(self, step, moment):
    kept(1)


def reads_a_property(self, step, moment):
    self.mean = self.energy[0]


def reads_a_property_of_a_table(self, step, moment):
    self.mean = Counted.read(self.ants).total


def calls_a_method_with_an_effect(self, step, moment):
    self.unsaid(1)


def cries(self, step, moment):
    self.run(moment, cry)


def runs_what_is_not_known(self, step, moment):
    rules = (graze,)
    self.run(moment, *rules, gain=1)


def writes_into_what_is_given(self, step, moment):
    np.add(self.days, 1, out=ROWS)


def imports(self, step, moment):
    import minerva_bus.space.effects  # noqa: F401


def tries(self, step, moment):
    try:
        self.days += 1
    except ValueError:
        NOTES.append(1)


def draws_of_numpy(self, step, moment):
    self.mean = np.random.random()


OTHERS = [
    emits, emits_by_another_name, passes_the_moment_on, prints, notes, changes_a_list,
    changes_a_default, reads_a_property, reads_a_property_of_a_table, calls_a_method_with_an_effect,
    cries, runs_what_is_not_known, writes_into_what_is_given, imports, tries, draws_of_numpy,
]  # fmt: skip


@pytest.mark.parametrize("method", PURE + OTHERS, ids=lambda method: method.__name__)
def test_only_methods_without_effects_run_ahead(method):
    cls = type("Tried", (Meadow,), {"step": on("eStep")(method)}, symbol="ATried")
    assert cls.kind.ahead is (method in PURE)
    if method in PURE:
        ants = Ant.many(4, cell=np.arange(4), energy=1.0)
        space = cls("m", width=2, height=2, births=4, ants=ants, grass=np.ones((2, 2), np.int16))
        assert evolve(space.string, [eStep(1.0)], [cls]).emitted == {}


def test_a_declaration_counts_more_than_the_proof():
    make = partial(type, "Tried", (Meadow,))
    assert not make({"step": on("eStep")(runs)}, symbol="ATried", ahead=False).kind.ahead
    declared = make({"step": on("eStep")(prints)}, symbol="ATried", ahead=True)
    assert declared.kind.ahead
    assert type("Inherits", (declared,), {}).kind.ahead
    proven = make({"step": on("eStep")(runs)}, symbol="ATried")
    assert not type("Adds", (proven,), {"more": on("eMore")(prints)}).kind.ahead


class Sheep(Agent, symbol="ASheep"):
    x: float = 0.0
    births: int = 0

    @on("eTick")
    def live(self, step, moment):
        self.x += moment.chance.normal(0, 1)
        return self.string + self.child(x=self.x) if self.x > 3 else None


class Dog(Agent, symbol="ADog"):
    x: float = 0.0

    @on("eStep", compiled=True)
    def bark(self, step, moment):
        if self.x > 3:
            moment.emit(eStep(size=self.x))


class Cat(Agent, symbol="ACat"):
    x: float = 0.0

    @on("eStep", compiled=True)
    def walk(self, step, moment):
        self.x += step.size


def test_compiled_methods_that_emit_nothing_run_ahead():
    assert (Sheep.kind.ahead, Dog.kind.ahead, Cat.kind.ahead) == (False, False, True)
    world = World(Sheep.many("s", 20), agents=[Sheep], services=[each(eTick)], name="flock")
    for compiled in (True, False):
        file = world.read(Overrides(compiled=compiled))
        assert file.world.vocabulary.kinds["ASheep"].ahead is compiled
        assert Sheep.kind.ahead is compiled
