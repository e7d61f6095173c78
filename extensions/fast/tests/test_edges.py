"""Graphs in spaces: edges, walkers on nodes, and errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from space_worlds import eStep, moment

from minerva_bus import Cells, MinervaError, Reals, on
from minerva_fast import (
    ORDERED,
    SHUFFLED,
    SIMULTANEOUS,
    Column,
    Draws,
    Edges,
    OnLattice,
    Space,
    degree,
    edge,
    interpreted,
    move_to,
    neighbour,
    random_neighbour,
    rule,
)


class Walker(OnLattice):
    steps: Column


@rule(SIMULTANEOUS)
def infect(node: int, ill: Cells, before: Cells, contacts: Edges, used: Reals):
    for k in range(degree(contacts, node)):
        if before[neighbour(contacts, node, k)] == 1:
            ill[node] = 1
            used[edge(contacts, node, k)] += 1


@rule(SHUFFLED, births=0)
def walk(i: int, walkers: Walker, contacts: Edges, draws: Draws):
    node = random_neighbour(contacts, walkers.cell[i], draws)
    if node >= 0:
        move_to(walkers, i, node)
        walkers.steps[i] += 1


@rule(ORDERED, births=0)
def wrong(node: int, ill: Cells, contacts: Edges, case: int):
    if case == 0:
        ill[node] = degree(contacts, -1)
    elif case == 1:
        ill[node] = neighbour(contacts, 0, degree(contacts, 0))


class Epidemic(Space, symbol="AEpidemic"):
    ill: Cells
    contacts: Reals
    used: Reals
    walkers: Reals
    case: int = -1

    @on("eStep")
    def step(self, step, moment):
        if self.case < 0:
            self.run(moment, infect, walk)
        else:
            self.run(moment, wrong, case=self.case)


def epidemic(pairs, nodes, case=-1, directed=False):
    ill = np.zeros((1, nodes), np.int16)
    ill[0, 0] = 1
    contacts = Edges.of(pairs, directed=directed)
    walkers = Walker.many(3, cell=[0, 1, nodes - 1], steps=0)
    used = np.zeros((1, max(1, contacts.shape[1])))
    return Epidemic("e", width=nodes, births=3, ill=ill, contacts=contacts, used=used,
                    walkers=walkers, case=case)  # fmt: skip


def reached(pairs, start, steps):
    """The nodes at most `steps` edges from a node."""
    nodes = {start}
    for _ in range(steps):
        nodes |= {b for a, b in pairs if a in nodes}
    return nodes


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=20), st.booleans())
def test_an_infection_follows_the_edges(pairs, directed):
    space = epidemic(pairs, 10, directed=directed)
    for frame in range(3):
        space.step(eStep(), moment(frame))
    # An ill node infects those that have an edge to it.
    to = {(b, a) for a, b in pairs} | (set() if directed else set(pairs))
    assert set(np.flatnonzero(space.ill[0])) == reached(to, 0, 3)
    ends = space.contacts[1].astype(int)
    assert all(end in reached(to, 0, 2) for end in ends[space.used[0, : len(ends)] > 0])
    walkers = Walker.read(space.walkers)
    out = set(pairs) if directed else to
    assert all(
        node in reached(out, start, 3) for node, start in zip(walkers.cell, (0, 1, 9), strict=True)
    )
    alone = [start not in {a for a, _ in out} for start in (0, 1, 9)]
    assert [steps == 0 for steps in walkers.steps] == alone


def test_a_compiled_graph_gives_the_string_of_an_interpreted_one():
    pairs = np.random.default_rng(1).integers(40, size=(80, 2))
    compiled, plain = epidemic(pairs, 40), epidemic(pairs, 40)
    for frame in range(4):
        compiled.step(eStep(), moment(frame))
        with interpreted():
            plain.step(eStep(), moment(frame))
    assert compiled.string.digest == plain.string.digest
    assert compiled.ill.sum() > 1


@pytest.mark.parametrize(
    ("case", "mistake"),
    [(0, "a node is not in the graph"), (1, "no edge with this number")],
)
def test_nodes_and_edges_that_do_not_exist_are_errors(case, mistake):
    with pytest.raises(IndexError, match=mistake):
        epidemic([(0, 1), (1, 2)], 4, case).step(eStep(), moment())


@pytest.mark.parametrize(
    ("pairs", "mistake"),
    [([0, 1], r"shape \(2,\)"), ([(0.5, 1)], "not float64"), ([(0, -1)], "numbers from 0, not -1")],
)
def test_pairs_that_are_no_edges(pairs, mistake):
    with pytest.raises(MinervaError, match=mistake):
        Edges.of(pairs)


@pytest.mark.parametrize(
    ("matrix", "mistake"),
    [
        ([[0.0, 4.0], [4.0, 0.0]], "edges between nodes from 0 to 4.*set `width`"),
        ([[1.0, 0.0], [0.0, 1.0]], "must be sorted by their first node"),
        ([[0.0]], "with 2 rows, not 1"),
    ],
)
def test_matrices_that_are_no_graph_of_the_space(matrix, mistake):
    space = epidemic([(0, 1)], 4)
    space.contacts = np.array(matrix)
    with pytest.raises(MinervaError, match=mistake):
        space.step(eStep(), moment())
