"""Results of benchmarks/scale_model.py for given costs."""

import numpy as np
import pytest

from benchmarks.scale_model import (
    Border,
    Costs,
    Kind,
    best_hosts,
    coordinator_seconds,
    frame_seconds,
    in_step,
    limits,
    most,
    most_bytes,
    most_members,
    region_seconds,
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


def test_the_border_of_small_regions_is_all_there_is_of_them():
    assert Border().share(1e6, 1) == 0.0
    assert Border(reach=10).share(1e6, 4) == pytest.approx(4 * 10 / 500)
    assert Border(reach=10).share(100, 4) == 1.0


def test_one_region_is_one_coordinator():
    hosts = best_hosts(COSTS, FOX, 1e5)
    assert region_seconds(COSTS, FOX, 1e5, 1) == frame_seconds(COSTS, FOX, 1e5, hosts)


def test_regions_pay_for_many_agents_and_not_for_few():
    assert region_seconds(COSTS, FOX, 1e7, 16) < region_seconds(COSTS, FOX, 1e7, 1) / 4
    assert region_seconds(COSTS, FOX, 1e2, 16) > region_seconds(COSTS, FOX, 1e2, 1)


def test_regions_of_constant_speed_do_not_wait():
    assert in_step(0.02, 16, spread=1.0) == pytest.approx(0.02)


def test_a_late_region_delays_its_neighbours():
    alone, several, wide = (in_step(1.0, regions, spread=3.0) for regions in (1, 4, 64))
    assert 1.0 < alone < several < wide
    assert wide == in_step(1.0, 64, spread=3.0)


def test_lateness_reaches_one_neighbour_further_with_each_frame(monkeypatch):
    """One slow region in a corner of 4 × 4: after two frames the far corner is unaffected."""

    class Once:
        frames = 0

        def standard_normal(self, shape):
            self.frames += 1
            drawn = np.full(shape, -50.0)
            if self.frames == 1:
                drawn[0, 0] = 0.0
            return drawn

    ended = []
    monkeypatch.setattr(np.random, "default_rng", lambda _: Once())
    monkeypatch.setattr("benchmarks.scale_model._beside", _noting(ended))
    in_step(1.0, 16, spread=3.0, frames=8)
    late = [(values > 0.5).sum() for values in ended]
    assert late[:7] == [0, 1, 3, 6, 10, 13, 15]


def _noting(ended):
    from benchmarks.scale_model import _beside

    def beside(ends, shift, axis):
        if (shift, axis) == (-1, 0):
            ended.append(ends.copy())
        return _beside(ends, shift, axis)

    return beside


def test_the_greatest_number_is_found():
    assert most(lambda n: n <= 700) == 700
    assert most(lambda n: n <= 1) == 1
    assert most(lambda n: False) == 0
    assert most(lambda n: n <= 5_000_000) == pytest.approx(5_000_000, rel=0.002)


def test_limits_are_where_the_rate_is_just_kept():
    assert most_members(COSTS, 30) == pytest.approx((1 / 30 - 2e-4) / 5e-5, abs=1)
    assert most_bytes(COSTS, 30) == pytest.approx((1 / 30 - 2e-4) / 2e-9, rel=0.002)
    by_regions = {limit.regions: limit for limit in limits(COSTS, 30)}
    single = by_regions[1]
    assert region_seconds(COSTS, FOX, single.agents, 1) <= 1 / 30
    assert region_seconds(COSTS, FOX, 1.01 * single.agents, 1) > 1 / 30
    assert single.bytes == single.agents * FOX.bytes
    assert by_regions[64].agents > 10 * single.agents
