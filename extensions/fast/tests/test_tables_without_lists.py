"""A table that no rule searches has no lists of the rows of cells, which changes no string."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba")

from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus import Cells, EventType, MinervaError, Reals, evolve, on
from minerva_bus.world.context import Frame
from minerva_fast import (
    ORDERED,
    SHUFFLED,
    SIMULTANEOUS,
    CellGrid,
    Column,
    Draws,
    InField,
    OnLattice,
    Space,
    beside,
    chance,
    copy,
    go_to,
    interpreted,
    move_to,
    near,
    next_cell,
    remove,
    rule,
    uniform,
    within,
)
from minerva_fast.tables import Opened

eStep = EventType("eStep", search=bool, risk=float, dx=int)


class Ant(OnLattice):
    load: Column


class Moth(InField):
    age: Column


@rule(SHUFFLED)
def walk(i: int, ants: Ant, food: Cells, lattice: CellGrid, draws: Draws, risk: float, dx: int):
    ants.load[i] += food[ants.cell[i]]
    move_to(ants, i, next_cell(lattice, ants.cell[i], draws))
    if chance(draws, risk):
        ants.load[copy(ants, i)] = 0.0
    elif chance(draws, risk):
        remove(ants, i)
        return
    move_to(ants, i, beside(lattice, ants.cell[i], dx, 0))


@rule(ORDERED)
def fly(i: int, moths: Moth, draws: Draws, risk: float):
    moths.age[i] += 1
    go_to(moths, i, moths.x[i] + uniform(draws, -2, 2), moths.y[i])
    if chance(draws, risk):
        go_to(moths, copy(moths, i), 1.0, 1.0)
    if chance(draws, risk):
        remove(moths, i)


@rule(SIMULTANEOUS)
def drift(i: int, moths: Moth, before: Moth):
    go_to(moths, i, before.x[i], before.y[i] + 0.5)


@rule(ORDERED)
def look(i: int, ants: Ant, moths: Moth):
    """Search both tables, and change nothing."""
    if within(ants, ants.cell[i], 1) < 0 or near(moths, 1.0, 1.0, 1.0, -1) < 0:
        ants.load[i] = -1.0


class Garden(Space, symbol="AGarden"):
    ants: Reals
    moths: Reals
    food: Cells

    @on("eStep")
    def step(self, step, moment):
        data = {"risk": step.risk, "dx": step.dx}
        if step.search:
            self.run(moment, walk, fly, drift, look, **data)
        else:
            self.run(moment, walk, fly, drift, **data)


def garden(periodic):
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 6, (2, 30))
    return Garden(
        "g", width=6, height=6, periodic=periodic, births=40,
        ants=Ant.many(20, cell=rng.integers(36, size=20), load=np.zeros(20)),
        moths=Moth.many(30, x=x, y=y, age=np.zeros(30)),
        food=rng.integers(3, size=(6, 6)).astype(np.int16),
    )  # fmt: skip


def history(periodic, frames, **data):
    """The strings of some frames, and the error if there is one."""
    scene, strings = garden(periodic).string, []
    for number in range(frames):
        try:
            frame = Frame(number, seed=3)
            scene = evolve(scene, [eStep(**data)], [Garden], frame).scene
        except MinervaError as error:
            return [*strings, str(error.__cause__)]
        strings.append(str(scene))
    return strings


@given(st.booleans(), st.sampled_from([0.0, 0.2, 0.6]), st.sampled_from([0, 1, 7]))
@settings(deadline=None, max_examples=12)
def test_strings_are_those_with_lists(periodic, risk, dx):
    lists = history(periodic, 4, search=True, risk=risk, dx=dx)
    assert history(periodic, 4, search=False, risk=risk, dx=dx) == lists
    with interpreted():
        assert history(periodic, 2, search=False, risk=risk, dx=dx) == lists[:2]


def test_lists_are_made_only_if_a_rule_searches(monkeypatch):
    made = []
    enlisted = Opened.enlist
    monkeypatch.setattr(
        Opened, "enlist", lambda self: (enlisted(self), made.append(self.rows.counts[1]))
    )
    history(True, 1, search=False, risk=0.0, dx=0)
    assert made
    assert set(made) == {-2}
    made.clear()
    history(True, 1, search=True, risk=0.0, dx=0)
    assert set(made) == {-1}
