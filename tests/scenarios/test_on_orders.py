"""A generator that has events on orders only is asked for no other frames, with the same strings."""

from dataclasses import replace
from random import Random

import pytest
from pond import VOCABULARY, Add, Steps, counters, eAdd, service

from minerva_bus import Device, Tick
from minerva_bus.errors import MisuseError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.member_table import incompatibility
from minerva_bus.world.services import Participation, When


class AskedAlways(Add):
    """Counts its orders in data that it saves, and has an event of its own in frame 0."""

    def __init__(self) -> None:
        super().__init__()
        self.taken = 0

    def takes_orders(self):
        return self.events

    def generate(self, tick):
        self.taken += len(tick.orders)
        first = (eAdd(-5),) if tick.number == 0 else ()
        return (*first, *(eAdd(-order.n * 10 - self.taken) for order in tick.orders))

    def save(self):
        return {"taken": self.taken}

    def restore(self, saved):
        self.taken = saved["taken"]


class OnOrders(AskedAlways, when="on orders"):
    """The same, and it says that it need not be asked."""


def taking(make=OnOrders, **more):
    return counters(members={"add": service("add", make), **more})


def test_it_is_asked_in_its_first_frame_and_in_those_with_orders():
    bus = taking().do("start, run 2, clear")
    bus.handle(s.Publish(eAdd(3)))
    bus.do("run 2").expect("""
        > order: eAdd<n=3>
        > begin
            says orders: eAdd<n=3> of people counts in frame 2
            add ← orders: eAdd<n=3>
            add ← tick 2
        > add: ticked 2: eAdd<n=-31>
            ~hosts ← evolve 2 on host: eAdd<n=-31>
        > host: evolved 2: #a #b
            frame 2 is done: eAdd<n=-31>; #a: ACounter#a<n=-36>(), #b: ACounter#b<n=-36>()
        > begin
            frame 3 is done: no events; no change
    """)


def disturbed(make, seed, *, calm):
    """Digests of a run with orders; unless `calm`, members and the coordinator are killed."""
    chance = Random(seed)
    orders = {frame: chance.randrange(1, 9) for frame in range(1, 40) if chance.random() < 0.2}
    bus = taking(make, steps=service("steps", Steps)).do("start, settle")
    while (frame := bus.algorithm.frame) < 40:
        if frame in orders:
            bus.handle(s.Publish(eAdd(orders.pop(frame))))
        match None if calm else chance.randrange(8):
            case 0:
                bus.restart(chance.choice(("add", "host", "steps")))
            case 1:
                bus.hold(("up", chance.choice(("add", "host", "steps"))))
                bus.do("frame, restart add, release")
            case 2 if not bus.algorithm.inbox:
                bus.kill_coordinator()
            case _:
                bus.frame()
        bus.settle()
        assert not bus.stuck
    return bus.digests


@pytest.mark.parametrize("seed", range(12))
def test_strings_are_those_of_a_generator_that_is_asked_always(seed):
    asked = disturbed(AskedAlways, seed, calm=True)
    assert disturbed(OnOrders, seed, calm=True) == asked
    assert disturbed(OnOrders, seed, calm=False) == asked


def test_a_new_process_is_asked_once_without_its_first_event():
    bus = taking().do("start, run 3")
    before = str(bus.algorithm.scene)
    bus.do("restart add, clear, run 3")
    assert sum("add ← tick" in line for line in bus.trace) == 1
    assert str(bus.algorithm.scene) == before


def test_an_order_that_arrives_while_it_is_away_waits_for_it():
    """It is killed in a frame for which it was not asked, and another generator delays."""
    bus = taking(steps=service("steps", Steps))
    bus.do("start, run 2, hold up steps, frame, vanish add, settle")
    bus.handle(s.Publish(eAdd(3)))
    bus.do("release, settle")
    assert bus.algorithm.waiting_for() == ["add"]
    bus.do("appear add, run 2")
    assert "n=-36" in str(bus.algorithm.scene)


def test_a_frame_that_no_longer_waits_for_it_asks_it_in_the_next():
    bus = taking().do("start, run 2, hold down add")
    bus.handle(s.Publish(eAdd(3)))
    bus.frame()
    bus.handle(s.Skip("add"))
    bus.do("settle, frame")
    assert bus.algorithm.waiting_for() == ["add"]


def test_an_order_for_a_frame_that_it_has_answered_counts_in_the_next():
    """The coordinator is killed in the first frame, when an order has arrived after the tick."""
    bus = taking(steps=service("steps", Steps))
    bus.do("start, settle, hold up steps, frame, kill_coordinator")
    bus.handle(s.Publish(eAdd(3)))
    bus.do("release, run 4")
    assert "n=-36" in str(bus.algorithm.scene)


def test_a_world_whose_generators_wait_for_orders_rests():
    bus = taking().do("start, run 1")
    assert bus.algorithm.frame == 1
    bus.run(1)
    assert bus.algorithm.at_rest
    bus.handle(s.Publish(eAdd(3)))
    assert not bus.algorithm.at_rest
    always = taking(AskedAlways).do("start, run 2")
    assert not always.algorithm.at_rest


class Drawing(OnOrders, Device, draws=("eShow",)):
    def show(self, view):
        pass


class Hearing(OnOrders):
    topics = ("sight",)


class Speaking(OnOrders):
    publishes = ("sight",)

    def generate(self, tick: Tick):
        return ()


@pytest.mark.parametrize(
    ("service", "reason"),
    [
        (Drawing, "draws views"),
        (Hearing, "subscribes to topics"),
        (Speaking, "publishes on topics"),
    ],
)
def test_it_cannot_depend_on_anything_else(service, reason):
    expected = f'its `when` is "on orders", so it has events on orders only, but it {reason}'
    with pytest.raises(MisuseError, match=f"{service.__name__}: {expected}"):
        Member("add", service())
    in_step = type("InStep", (service,), {}, when="in step")
    hello = Member("add", in_step()).hello()
    assert not incompatibility(hello, VOCABULARY)
    on_orders = replace(hello, when=When(Participation.ON_ORDERS))
    assert incompatibility(on_orders, VOCABULARY) == expected
