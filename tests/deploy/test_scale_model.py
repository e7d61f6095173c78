"""Results of benchmarks/scale_model.py for given costs."""

import pytest

from benchmarks.scale_model import (
    Costs,
    Kind,
    best_hosts,
    coordinator_seconds,
    frame_seconds,
    limits,
    most,
    most_bytes,
    most_members,
)

FOX = Kind(coordinator=1e-8, host=1e-6, bytes=10.0)
COSTS = Costs(frame=2e-4, member=5e-5, byte=2e-9, spread=1.0, kinds={"fox": FOX})


def test_a_frame_is_the_exchange_and_what_agents_cost():
    assert frame_seconds(COSTS, FOX, 0, 4) == pytest.approx(4e-4)
    assert coordinator_seconds(COSTS, FOX, 1e6) == pytest.approx(0.03)
    assert frame_seconds(COSTS, FOX, 1e6, 10) == pytest.approx(2e-4 + 5e-4 + 0.03 + 0.1)


def test_hosts_help_until_they_cost_more_than_they_take():
    hosts = best_hosts(COSTS, FOX, 1e5)
    best = frame_seconds(COSTS, FOX, 1e5, hosts)
    assert best <= frame_seconds(COSTS, FOX, 1e5, hosts // 2)
    assert best <= frame_seconds(COSTS, FOX, 1e5, hosts * 2)
    assert best_hosts(COSTS, FOX, 10) == 1


def test_the_greatest_number_is_found():
    assert most(lambda n: n <= 700) == 700
    assert most(lambda n: n <= 1) == 1
    assert most(lambda n: False) == 0
    assert most(lambda n: n <= 5_000_000) == pytest.approx(5_000_000, rel=0.002)


def test_limits_are_where_the_rate_is_just_kept():
    assert most_members(COSTS, 30) == pytest.approx((1 / 30 - 2e-4) / 5e-5, abs=1)
    assert most_bytes(COSTS, 30) == pytest.approx((1 / 30 - 2e-4) / 2e-9, rel=0.002)
    (limit,) = limits(COSTS, 30)
    assert limit.hosts == best_hosts(COSTS, FOX, limit.agents)
    assert frame_seconds(COSTS, FOX, limit.agents, limit.hosts) <= 1 / 30
    more = 1.01 * limit.agents
    assert frame_seconds(COSTS, FOX, more, best_hosts(COSTS, FOX, more)) > 1 / 30
    assert limit.bytes == limit.agents * FOX.bytes
