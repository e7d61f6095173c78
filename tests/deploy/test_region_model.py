"""Results of benchmarks/region_model.py for given costs, and costs for given times."""

from dataclasses import replace

import pytest

from benchmarks.region_model import (
    RegionCosts,
    coordinator_seconds,
    figures,
    frame_seconds,
    neighbours,
    predicted,
    region_seconds,
    slowest,
)
from benchmarks.region_model_costs import Times, fitted

COSTS = RegionCosts(
    whole=5e-4, report=4e-4, whole_agent=1e-6, frame=1e-3, agent=4e-6, neighbour=3e-4, figure=2e-6
)
ZENOH = replace(COSTS, member=3e-5, byte=2e-9, spread=1.5)


def test_a_region_alone_has_no_borders():
    assert neighbours(1) == 0
    assert figures(1000, 1) == 0.0
    assert region_seconds(ZENOH, 1000, 1) == pytest.approx(5e-3)


def test_a_region_pays_for_its_neighbours_and_their_figures():
    # A square of 10 m has four strips and four corners around it.
    assert figures(100, 9) == pytest.approx(16**2 - 10**2)
    assert region_seconds(ZENOH, 100, 9) == pytest.approx(1.4e-3 + 8 * 3.3e-4 + 156 * 2e-6)


def test_a_coordinator_pays_for_reports_agents_and_requests():
    reports, agents, requests = 9 * 4.3e-4, 900 * 1e-6, 9 * 9 * 8 * 4 * 2e-9
    assert coordinator_seconds(ZENOH, 100, 9) == pytest.approx(5e-4 + reports + agents + requests)


def test_a_frame_takes_as_long_as_the_slowest_region():
    assert slowest(1.0, 4096) == slowest(1.5, 1) == 1.0
    assert slowest(1.5, 99) == pytest.approx(1.5)
    assert 1.0 < slowest(1.5, 4) < slowest(1.5, 4096)
    both = region_seconds(COSTS, 100, 9) + coordinator_seconds(COSTS, 100, 9)
    assert frame_seconds(COSTS, 100, 9) == pytest.approx(both)


def test_costs_are_found_from_times():
    worlds = [(1, 100), (1, 2000), (4, 500), (9, 100), (9, 1000), (16, 400)]
    times = [
        Times(
            regions, agents, coordinator_seconds(COSTS, agents, regions),
            region_seconds(COSTS, agents, regions),
        )
        for regions, agents in worlds
    ]  # fmt: skip
    costs = fitted(times)
    for name in COSTS.__dataclass_fields__:
        assert getattr(costs, name) == pytest.approx(getattr(COSTS, name)), name


def test_costs_are_never_negative():
    times = [Times(1, 100, 1e-3, 1e-3), Times(1, 2000, 1e-3, 5e-4), Times(4, 500, 1e-3, 9e-4)]
    costs = fitted(times)
    assert min(getattr(costs, name) for name in COSTS.__dataclass_fields__) >= 0.0


def test_what_takes_most_of_a_coordinators_time_depends_on_the_world():
    first = {
        (agents, regions): predicted(ZENOH, agents, regions, 30).first
        for agents, regions in ((10, 1), (10, 64), (1000, 64), (10, 65536))
    }
    assert [*first.values()] == ["frame", "reports", "agents", "requests"]


def test_a_tree_of_reports_saves_reports_but_not_the_work_for_agents():
    few, many = (predicted(ZENOH, agents, 1024, 30) for agents in (10, 1000))
    assert few.tree_rate > 5 * few.rate
    assert many.rate < many.tree_rate < 2 * many.rate


def test_the_most_agents_at_a_rate_just_keep_it():
    row = predicted(ZENOH, 1000, 4, 30)
    assert frame_seconds(ZENOH, row.agents_at_rate / 4, 4) <= 1 / 30
    assert frame_seconds(ZENOH, 1.01 * row.agents_at_rate / 4, 4) > 1 / 30
