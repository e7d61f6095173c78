"""Shares of a population in proportion to the measured speed of its hosts."""

from minerva_bus.frame.placement import WINDOW, Load


def measured(**speeds):
    load = Load()
    for host, speed in speeds.items():
        for _ in range(WINDOW):
            load.note(host, 1000, 1000 / speed)
    return load


def test_shares_are_equal_until_all_hosts_are_known():
    load = Load()
    assert load.weights(["a", "b"], 10**6) == [1.0, 1.0]
    for _ in range(WINDOW):
        load.note("a", 1000, 0.1)
    assert load.weights(["a", "b"], 10**6) == [1.0, 1.0]
    assert not load.imbalanced({"a": 10**6, "b": 10**6})


def test_a_host_twice_as_quick_gets_twice_as_much():
    load = measured(a=2e6, b=1e6)
    first, other = load.weights(["a", "b"], 10**6)
    assert round(first / other, 6) == 2.0
    assert load.imbalanced({"a": 500_000, "b": 500_000})
    assert not load.imbalanced({"a": 666_000, "b": 333_000})


def test_of_few_rows_each_host_has_as_many():
    """Otherwise a host with fewer rows would measure slower and lose rows until none remain."""
    assert measured(a=2e6, b=1e3).weights(["a", "b"], 200) == [1.0, 1.0]


def test_few_rows_are_not_worth_moving_and_one_host_has_all():
    assert not measured(a=2e6, b=1e6).imbalanced({"a": 8000, "b": 8000})
    assert not measured(a=2e6).imbalanced({"a": 10**6})


def test_one_slow_frame_changes_nothing():
    load = measured(a=1e6, b=1e6)
    load.note("a", 1000, 60.0)
    for _ in range(WINDOW):  # A frame without rows, or of no time, says nothing.
        load.note("a", 0, 1.0)
        load.note("b", 1000, 0.0)
    assert not load.imbalanced({"a": 500_000, "b": 500_000})


def test_old_violations_expire():
    load = measured(a=1e6, b=1e6)
    for _ in range(WINDOW):
        load.note("b", 1000, 1000 / 4e6)
    assert load.imbalanced({"a": 500_000, "b": 500_000})
