"""Placement of agents: rules, capacity, and shares of a population."""

from hypothesis import given
from hypothesis import strategies as st

from minerva_bus.frame.placement import PlacementRules, Rule, apportion, fit

OFFERS = {
    "foxes-1": frozenset({"AFox", "ARabbit"}),
    "foxes-2": frozenset({"AFox"}),
    "yard": frozenset({"AFox", "AGuard"}),
}
MACHINES = {"foxes-1": "east", "foxes-2": "west", "yard": "west", "sensor": "west"}


def allowed(machines=MACHINES, **rules):
    return PlacementRules(rules).allowed(OFFERS, machines)


def test_without_rules_all_is_allowed():
    assert PlacementRules().allowed(OFFERS, {}) == OFFERS


def test_a_kind_may_be_confined_to_hosts_by_name_or_pattern():
    allowed_kinds = allowed(AFox=Rule(only=("foxes-*",)))
    assert allowed_kinds == {**OFFERS, "yard": frozenset({"AGuard"})}
    assert allowed(AGuard=Rule(only=("foxes-1",)))["yard"] == frozenset({"AFox"})


def test_a_kind_may_have_to_live_on_the_machine_of_a_member():
    allowed_kinds = allowed(AFox=Rule(near="sensor"))
    assert [host for host, kinds in allowed_kinds.items() if "AFox" in kinds] == ["foxes-2", "yard"]


def test_near_a_member_that_is_not_there_is_nowhere():
    allowed_kinds = allowed({**MACHINES, "sensor": "moon"}, AFox=Rule(near="sensor"))
    assert not any("AFox" in kinds for kinds in allowed_kinds.values())
    assert not any("AFox" in k for k in allowed({}, AFox=Rule(near="sensor")).values())


def test_a_host_without_a_known_machine_is_not_near_an_absent_member():
    allowed_kinds = allowed({**MACHINES, "yard": ""}, AFox=Rule(near="sensor"))
    assert [host for host, kinds in allowed_kinds.items() if "AFox" in kinds] == ["foxes-2"]
    allowed_kinds = allowed({"foxes-1": "", "foxes-2": "", "yard": ""}, AFox=Rule(near="sensor"))
    assert not any("AFox" in kinds for kinds in allowed_kinds.values())


rooms = st.lists(st.integers(1, 100), min_size=1, max_size=5)


@given(rows=st.integers(1, 300), rooms=rooms)
def test_apportioning_respects_capacity_and_covers_all_rows(rows, rooms):
    sizes = apportion(rows, [1.0] * len(rooms), rooms)
    assert sum(sizes) == rows
    assert all(size <= room for size, room in zip(sizes, rooms, strict=False))
    assert len(sizes) == len(rooms) + (rows > sum(rooms))
    assert fit(sizes, sizes, rooms)


def test_with_room_for_all_shares_are_by_weight():
    assert apportion(90, [2.0, 1.0], [1000, 1000]) == [60, 30]
    assert apportion(90, [2.0, 1.0], [50, 1000]) == [50, 40]


def test_parts_stay_as_they_are_while_each_has_its_room():
    assert fit([70, 20], [45, 45], [80, 80])
    assert not fit([70, 20], [45, 45], [60, 80])
    assert not fit([60, 80, 30], [60, 80, 20], [60, 80])
