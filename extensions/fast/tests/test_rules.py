"""Rules of spaces: activation, births and deaths, draws, searches, and messages of errors."""

import sys
from contextlib import nullcontext

import numpy as np
import pytest
from space_worlds import (
    Bird,
    Meadow,
    Resident,
    Sheep,
    count_near,
    drift,
    eStep,
    flock,
    grow,
    look,
    meadow,
    moment,
    town,
)

from minerva_bus import MinervaError, Reals, evolve, portable
from minerva_bus.grammar.scene import agents
from minerva_bus.portable import cos
from minerva_bus.world.context import Frame
from minerva_fast import (
    ORDERED,
    SHUFFLED,
    SIMULTANEOUS,
    CellGrid,
    Column,
    Draws,
    OnLattice,
    Space,
    chance,
    copy,
    exponential,
    go_to,
    integers,
    interpreted,
    near,
    normal,
    places,
    random,
    random_at,
    remove,
    rule,
    uniform,
)
from minerva_fast.draws import new_progress
from minerva_fast.tables import Opened


@pytest.fixture
def as_python():
    with interpreted():
        yield


def after(space, frames):
    scene = space.string
    for number in range(frames):
        scene = evolve(scene, [eStep()], [type(space)], Frame(number, seed=4)).scene
    return scene


def state(space, frames):
    (node,) = agents(after(space, frames))
    return node.state


@pytest.mark.parametrize("make", [meadow, flock, town])
def test_compiled_rules_give_the_same_string_as_interpreted_ones(make):
    compiled = after(make(), 6)
    with interpreted():
        assert after(make(), 6).digest == compiled.digest
    assert compiled.digest != make().string.digest


def test_an_interpreted_rule_does_not_need_numba(as_python, monkeypatch):
    @rule(ORDERED)
    def fatten(i: int, sheep: Sheep):
        sheep.energy[i] += 1

    monkeypatch.setitem(sys.modules, "numba", None)
    space = meadow(sheep=3, wolves=0)
    space.run(moment(), fatten)
    assert Sheep.read(space.sheep).energy.tolist() == [3, 3, 3]


def test_compiled_rules_without_numba_name_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)

    @rule(ORDERED)
    def fatten(i: int, sheep: Sheep):
        sheep.energy[i] += 1

    with pytest.raises(MinervaError, match=r"rules of a space need numba: .*minerva-bus\[fast\]"):
        fatten.prepare()


@rule(ORDERED)
def stray(i: int, birds: Bird, draws: Draws):
    go_to(birds, i, y=9 * uniform(draws), x=9 * uniform(draws))


def test_arguments_of_functions_are_evaluated_in_the_order_in_which_they_are_written():
    compiled, plain = flock(), flock()
    compiled.run(moment(), stray)
    with interpreted():
        plain.run(moment(), stray)
    assert compiled.birds.tobytes() == plain.birds.tobytes()


class Dots(OnLattice):
    value: Column


class Line(Space, symbol="ALine"):
    table: Reals


@rule(ORDERED, births=0)
def draw_all(i: int, table: Dots, draws: Draws):
    drawn = random(draws) + uniform(draws) + uniform(draws, -1, 3.5) + integers(draws, 5)
    drawn += integers(draws, 2, 9) + chance(draws, 0.3) + exponential(draws)
    drawn += exponential(draws, 2.5) + normal(draws) + normal(draws, 1.0, 0.5)
    table.value[i] = drawn + portable.sin(drawn) + cos(drawn)


def drawn_by(rng):
    drawn = rng.random() + rng.uniform() + rng.uniform(-1, 3.5) + rng.integers(5)
    drawn += rng.integers(2, 9) + rng.chance(0.3) + rng.exponential()
    drawn += rng.exponential(2.5) + rng.normal() + rng.normal(1.0, 0.5)
    return drawn + portable.sin(drawn) + cos(drawn)


@pytest.mark.parametrize("context", [nullcontext, interpreted])
def test_draws_are_those_of_the_moment(context):
    line = Line("l", births=50, table=Dots.many(50, cell=0, value=0))
    here, same = moment(5), moment(5)
    with context():
        line.run(here, draw_all)
    assert Dots.read(line.table).value.tolist() == [drawn_by(same.chance) for _ in range(50)]
    # The stream continues after the rule.
    assert here.chance.random() == same.chance.random()


@pytest.mark.parametrize("context", [nullcontext, interpreted])
def test_an_int_of_an_empty_range_is_an_error(context):
    @rule(ORDERED, births=0)
    def none(i: int, table: Dots, draws: Draws):
        table.value[i] = integers(draws, 3, 3)

    line = Line("l", births=1, table=Dots.many(1, cell=0, value=0))
    with context(), pytest.raises(ValueError, match="expected low < high"):
        line.run(moment(), none)


@pytest.mark.parametrize("births", [0, 1])
def test_more_births_than_a_rule_declares_are_an_error(as_python, births):
    @rule(ORDERED, births=births)
    def twice(i: int, sheep: Sheep):
        copy(sheep, i)
        copy(sheep, i)

    with pytest.raises(IndexError, match="births"):
        meadow(sheep=3, wolves=0).run(moment(), twice)


def test_copies_have_the_values_of_their_parents_and_rising_ids(as_python):
    @rule(ORDERED, births=2)
    def twins(i: int, sheep: Sheep):
        copy(sheep, i)
        copy(sheep, i)

    space = meadow(sheep=3, wolves=0)
    space.run(moment(), twins)
    sheep = Sheep.read(space.sheep)
    assert sheep.id.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8]
    assert sheep.cell.tolist()[3:] == [cell for cell in sheep.cell.tolist()[:3] for _ in "ab"]
    assert space.births == 9


def test_removed_rows_take_part_in_nothing(as_python):
    @rule(ORDERED)
    def cull(i: int, sheep: Sheep):
        if i % 2:
            remove(sheep, i)

    @rule(ORDERED)
    def mark(i: int, sheep: Sheep, draws: Draws):
        sheep.energy[i] = random_at(sheep, sheep.cell[i], draws)

    space = meadow(side=2, sheep=9, wolves=0)
    space.run(moment(), cull, mark)
    sheep = Sheep.read(space.sheep)
    assert sheep.id.tolist() == [0, 2, 4, 6, 8]
    assert all(int(row) % 2 == 0 for row in sheep.energy)


def test_newborns_wait_for_the_next_rule_and_ids_are_not_given_again(as_python):
    @rule(ORDERED)
    def end(i: int, sheep: Sheep):
        remove(sheep, i)

    @rule(ORDERED)
    def bear(i: int, wolves: Sheep):
        copy(wolves, i)

    space = meadow(sheep=2, wolves=1)
    space.run(moment(), end, bear)
    assert Sheep.read(space.wolves).id.tolist() == [2, 3]
    assert space.sheep.shape == (3, 0)
    space.run(moment(), bear)
    assert Sheep.read(space.wolves).id.tolist() == [2, 3, 4, 5]


def test_simultaneous_rules_see_the_state_before(as_python):
    @rule(SIMULTANEOUS, births=0)
    def follow(i: int, sheep: Sheep, before: Sheep):
        sheep.energy[i] = before.energy[(i + 3) % 4] + 1

    @rule(ORDERED, births=0)
    def add_up(i: int, sheep: Sheep):
        sheep.energy[i] = sheep.energy[(i + 3) % 4] + 1

    space = meadow(sheep=4, wolves=0)
    space.run(moment(), follow)
    assert Sheep.read(space.sheep).energy.tolist() == [3, 3, 3, 3]
    space.run(moment(), add_up)
    assert Sheep.read(space.sheep).energy.tolist() == [4, 5, 6, 7]


def test_shuffled_rules_have_another_order_in_each_frame(as_python):
    orders = set()
    for frame in range(5):

        @rule(SHUFFLED, births=0)
        def number(i: int, sheep: Sheep, first: Reals):
            sheep.energy[i] = first[0]
            first[0] += 1

        class Line(Meadow, symbol="ALine"):
            first: Reals

        made = meadow(sheep=8, wolves=0)
        line = Line("l", width=12, height=12, births=8, sheep=made.sheep, wolves=made.wolves,
                    grass=made.grass, first=np.zeros((1, 1)))  # fmt: skip
        line.run(moment(frame), number)
        order = tuple(Sheep.read(line.sheep).energy)
        assert sorted(order) == list(range(8))
        orders.add(order)
    assert len(orders) > 3


@rule(ORDERED, births=0)
def look_now(i: int, birds: Bird, sight: float):
    birds.seen[i] = near(birds, birds.x[i], birds.y[i], sight, i)
    birds.sum_x[i] = birds.sum_y[i] = 0.0
    for k in range(int(birds.seen[i])):
        birds.sum_x[i] += birds.dx[k]
        birds.sum_y[i] += birds.dy[k]


@pytest.mark.parametrize("periodic", [False, True])
def test_rows_sorted_by_cell_are_found_in_the_order_of_their_lists(as_python, periodic):
    sorted_rows, lists = flock(periodic=periodic), flock(periodic=periodic)
    sorted_rows.run(moment(), drift, look)
    lists.run(moment(), drift, look_now)
    # Also the last bits of sums.
    assert sorted_rows.birds.tobytes() == lists.birds.tobytes()
    assert Bird.read(lists.birds).seen.max() > 3


@pytest.mark.parametrize(("part", "cells"), [(1.0, 20), (0.05, 300), (1e-6, 390)])
def test_a_crowded_field_has_smaller_cells(part, cells):
    birds = flock(40, 300.0, 200.0, part=part).birds
    field = Opened.of(
        Bird, birds, CellGrid(300, 200, True), (300.0, 200.0), np.array([40]), vacant=None, room=0
    ).shape
    assert cells * 0.7 <= field.across * field.down <= cells


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize(
    ("width", "height", "sight", "part"),
    [(30, 20, 4, 1.0), (9, 7, 3, 1.0), (6, 40, 5, 1.0), (4, 4, 9, 1.0), (300, 200, 4, 0.05)],
)
def test_near_finds_the_rows_that_all_pairs_give(as_python, periodic, width, height, sight, part):
    space = flock(40, float(width), float(height), periodic, float(sight), part)
    birds = Bird.read(state(space, 1)["birds"])
    dx, dy = birds.x - birds.x[:, None], birds.y - birds.y[:, None]
    if periodic:
        dx -= width * np.round(dx / width)
        dy -= height * np.round(dy / height)
    close = dx * dx + dy * dy <= sight * sight
    np.fill_diagonal(close, val=False)
    assert birds.seen.tolist() == close.sum(axis=1).tolist()
    if 2 * sight < min(width, height):
        np.testing.assert_allclose(birds.sum_x, (dx * close).sum(axis=1), atol=1e-9)
        np.testing.assert_allclose(birds.sum_y, (dy * close).sum(axis=1), atol=1e-9)


def test_a_search_away_from_the_edges_finds_the_same(monkeypatch):
    random, results = np.random.default_rng(2), []
    x, y = random.uniform(0, 30, (2, 200))
    x[:60], y[40:100] = random.uniform(-40, 70, (2, 60))  # some of them outside
    birds = Bird.many(200, x=x, y=y, seen=0, sum_x=0, sum_y=0)
    for known in (places.reaches_no_edge, lambda *_: False):
        monkeypatch.setattr(places, "reaches_no_edge", known)
        space = flock(200, 30.0, 30.0)
        space.birds = birds
        with interpreted():
            space.run(moment(), look_now, sight=5.0)
        results.append(space.birds.tobytes())
    assert results[0] == results[1]
    assert Bird.read(space.birds).seen.max() > 3


@rule(ORDERED, births=0)
def count_around(i: int, birds: Bird, x: float, radius: float):
    birds.seen[i] = near(birds, x, 0.0, radius, -1)


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize(
    ("x", "radius", "seen"), [(0.0, 1e300, 40), (1e300, 4.0, 0), (0.0, -4.0, 0)]
)
def test_a_search_takes_any_position_and_distance(as_python, periodic, x, radius, seen):
    space = flock(40, periodic=periodic)
    space.run(moment(), count_around, x=x, radius=radius)
    assert set(Bird.read(space.birds).seen) == {seen}


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("radius", [1, 2, 3, 6])
def test_within_finds_the_rows_that_all_pairs_give(as_python, periodic, radius):
    space = town(20, 7, periodic)
    space.run(moment(), count_near, radius=radius)
    residents = Resident.read(space.residents)
    y, x = np.divmod(residents.cell, 7)
    dx, dy = abs(x - x[:, None]), abs(y - y[:, None])
    if periodic:
        dx, dy = np.minimum(dx, 7 - dx), np.minimum(dy, 7 - dy)
    expected = (np.maximum(dx, dy) <= radius).sum(axis=1)
    assert residents.near.tolist() == expected.tolist()


def test_a_cell_has_at_most_one_resident_if_all_move_to_free_cells(as_python):
    cells = Resident.read(state(town(50, 8), 5)["residents"]).cell
    assert len(set(cells.tolist())) == 50


def test_a_cell_outside_the_lattice_is_an_error(as_python):
    space = meadow(side=4, sheep=3, wolves=0)
    space.sheep = Sheep.many(3, cell=16, energy=0)
    with pytest.raises(MinervaError, match="cells are numbers from 0 to 15"):
        space.run(moment(), grow_all)


@rule(ORDERED)
def grow_all(i: int, sheep: Sheep):
    sheep.energy[i] += 1


def test_ids_must_be_below_births(as_python):
    space = meadow()
    space.births = 3
    with pytest.raises(MinervaError, match="set births="):
        space.run(moment(), grow_all)


def test_a_rule_names_its_parameters(as_python):
    with pytest.raises(MinervaError, match="subject"):
        rule(ORDERED)(lambda i: None)

    def wrong(i: int, sheep: Sheep, text: str): ...

    with pytest.raises(MinervaError, match="text must be"):
        rule(ORDERED)(wrong)

    @rule(ORDERED)
    def missing(i: int, sheep: Sheep, weather: float): ...

    with pytest.raises(MinervaError, match="no attribute weather"):
        meadow().run(moment(), missing)


def test_a_rule_may_create_lists():
    @rule(ORDERED)
    def average(i: int, sheep: Sheep):
        recent = [0.0] * 2
        recent[0] = sheep.energy[i]
        sheep.energy[i] = (recent[0] + recent[1]) / len(recent)

    compiled = meadow()
    compiled.run(moment(), average)
    with interpreted():
        slow = meadow()
        slow.run(moment(), average)
    assert compiled.string == slow.string != meadow().string


def test_running_a_rule_keeps_no_references_to_its_arrays():
    grass, cells, draws = np.ones(16, np.int16), np.arange(16), np.zeros(1, np.uint64)
    before = sys.getrefcount(grass), sys.getrefcount(cells)
    for _ in range(10):
        grow.compiled()(0, 16, cells, new_progress(), draws, grass)
    assert (sys.getrefcount(grass), sys.getrefcount(cells)) == before


def test_tables_explain_wrong_names():
    with pytest.raises(MinervaError, match="has no enrgy"):
        Sheep.many(1, cell=0, enrgy=1)
    with pytest.raises(MinervaError, match="needs energy"):
        Sheep.many(1, cell=0)
    with pytest.raises(MinervaError, match="has 3 rows"):
        Sheep.read(np.zeros((2, 1)))
    with pytest.raises(MinervaError, match="taken"):
        type("Bad", (OnLattice,), {"__annotations__": {"links": Column}})
