"""gDecide, gRepresent, gObjective and gSpeed: events of each frame, and orders of people."""

from typing import Any

import pytest
from driving_world import INFO, joined, tick

from minerva_bus import Event, MinervaError
from minerva_bus.frame.member_side import Member
from minerva_services.input.each import Each
from minerva_services.input.orders import Orders

eObjective = INFO.vocabulary.events["eObjective"]


def made(service: Any, number: int, *orders: Event) -> list[Event]:
    return list(service.generate(tick(number, orders=orders)))


def test_each_makes_one_event_each_frame() -> None:
    service = joined(Each("eDecide"))
    assert service.generates() == ("eDecide",)
    for number in range(3):
        assert made(service, number) == [INFO.vocabulary.events["eDecide"]()]


def test_it_is_asked_in_every_so_many_frames() -> None:
    for every, when in ((1, "in step"), (3, "in step, each 3 frames")):
        hello = Member("each", Each("eRepresent", every=every)).hello()
        assert str(hello.when) == when
    assert made(joined(Each("eRepresent", every=3)), 6)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"event": "eObjective"}, r"each: eObjective needs marker \(text\)"),
        ({"event": "eDecode"}, "each: .* no event type eDecode; did you mean 'eDecide'"),
        ({"event": "eDecide", "every": 0}, "each: every is 0; expected"),
    ],
)
def test_each_refuses_what_it_cannot_make(options: dict[str, Any], problem: str) -> None:
    with pytest.raises(MinervaError, match=problem):
        joined(Each(**options))


def test_the_first_order_is_sent_in_frame_0_only() -> None:
    service = joined(Orders("eObjective", first={"marker": "kitchen"}))
    assert (service.generates(), service.takes_orders()) == (("eObjective",), ("eObjective",))
    assert made(service, 0) == [eObjective("kitchen")]
    assert made(service, 1) == []


def test_a_successor_gives_the_first_order_in_frame_0_again_and_in_no_other() -> None:
    for number in range(3):
        service = joined(Orders("eObjective", first={"marker": "kitchen"}))
        assert len(made(service, number)) == (number == 0)


def test_orders_of_people_follow_the_first_order_and_take_precedence() -> None:
    service = joined(Orders("eObjective", first={"marker": "kitchen"}))
    bath, hall = eObjective("bath"), eObjective("hall")
    assert made(service, 0, bath) == [eObjective("kitchen"), bath]
    assert made(service, 1, bath, hall) == [bath, hall]


def test_without_a_first_order_it_waits_for_people() -> None:
    service = joined(Orders("eObjective"))
    assert made(service, 0) == []
    assert made(service, 0, eObjective("bath")) == [eObjective("bath")]


def test_the_first_order_may_be_for_some_agents_only() -> None:
    service = joined(Orders("eObjective", first={"marker": "hall", "receivers": ["r2", "r1"]}))
    assert made(service, 0) == [eObjective("hall", receivers=["r1", "r2"])]


@pytest.mark.parametrize("first", [{}, {"marker": 3}, {"marker": "hall", "speed": 3}])
def test_a_first_order_that_does_not_fit_is_refused(first: dict[str, Any]) -> None:
    with pytest.raises(MinervaError, match="orders: first does not fit eObjective: eObjective"):
        joined(Orders("eObjective", first=first))


def test_orders_of_an_unknown_type_are_refused() -> None:
    with pytest.raises(MinervaError, match="orders: the world 'yard' has no event type eSpeed"):
        joined(Orders("eSpeed"))
