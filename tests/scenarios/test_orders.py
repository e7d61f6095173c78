"""Orders of people: through a generator that takes them, or directly into the next frame."""

import pytest
from pond import Add, Steps, counters, eAdd, eStep, service, started

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.world.norms import Norm


class Taker(Add):
    """Doubles the orders of people, and adds nothing else."""

    def takes_orders(self):
        return self.events

    def generate(self, tick):
        return [eAdd(2 * order.n, receivers=order.receivers) for order in tick.orders]


def taking(**more):
    return counters(members={"add": service("add", Taker), **more})


def test_an_order_goes_through_the_generator_that_takes_it():
    bus = taking().do("start, run 1, clear")
    bus.handle(s.Publish(eAdd(3)))
    bus.do("run 2").expect("""
        > order: eAdd<n=3>
        > begin
            says orders: eAdd<n=3> of people counts in frame 1
            add ← orders: eAdd<n=3>
            ~tick ← tick 1
        > add: ticked 1: eAdd<n=6>
            host ← fragments #a #b
            ~hosts ← evolve 1 on host: eAdd<n=6>
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=6>; #a: ACounter#a<n=6>(), #b: ACounter#b<n=6>()
        > begin 2
        > add: ticked 2: no events
            frame 2 is done: no events; no change
    """)


def test_an_order_without_a_taker_counts_in_the_next_frame():
    bus = started()
    bus.handle(s.Publish(eAdd(3, receivers=["b"])))
    bus.do("run 2").expect("""
        > order: eAdd<n=3> to #b
        > begin 1
        > add: ticked 1: eAdd<n=1>
            says orders: eAdd<n=3> to #b of people counts in frame 1
            ~hosts ← evolve 1 on host: eAdd<n=1>, eAdd<n=3> to #b
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=1>, eAdd<n=3> to #b; #a: ACounter#a<n=2>(), #b: ACounter#b<n=5>()
        > frame 2 as usual: #a: ACounter#a<n=3>(), #b: ACounter#b<n=6>()
    """)


@pytest.mark.parametrize("service_of_add", [Add, Taker])
def test_each_order_is_judged_with_its_person_and_the_norm_that_rejects_it(service_of_add):
    norm = Norm("few", (), ("eAdd",), when="event.n > 8")
    bus = counters(members={"add": service("add", service_of_add)}, norms=(norm,))
    receive = bus.do("start, run 1").algorithm.receive
    receive(s.Publish(eAdd(3), "anna"))
    receive(s.Publish(eAdd(9), "bert"))
    out = [*receive(s.Begin()), *receive(m.TickReply("add", 1))]
    assert [each for each in out if isinstance(each, s.OrderJudged)] == [
        s.OrderJudged(eAdd(9), "bert", 1, "rejected", "few"),
        s.OrderJudged(eAdd(3), "anna", 1),
    ]


def test_orders_in_a_tick_wait_for_the_next():
    bus = taking(slow=service("slow", Steps)).do("start, run 1, hold up slow, frame")
    bus.handle(s.Publish(eAdd(3)))
    bus.do("settle, release, settle")
    assert "n=0" in str(bus.algorithm.scene)
    bus.run(1)
    assert "n=6" in str(bus.algorithm.scene)


def test_many_orders_keep_their_order_and_each_counts():
    bus = taking().do("start, run 1")
    for n in (1, 2, 3):
        bus.handle(s.Publish(eAdd(n)))
    bus.run(1)
    assert [str(event) for event in bus.records[-1].events] == [
        "eAdd<n=2>", "eAdd<n=4>", "eAdd<n=6>",
    ]  # fmt: skip


def test_an_order_whose_taker_is_away_is_not_lost():
    """It is kept until the frame and passes through the taker, which has returned by then."""
    bus = taking().do("start, run 1, vanish add, settle")
    bus.handle(s.Publish(eAdd(3)))
    bus.do("appear add, run 1")
    assert "n=6" in str(bus.algorithm.scene)


def test_an_order_whose_taker_has_gone_for_good_counts_as_it_is():
    bus = taking().do("start, run 1")
    bus.handle(s.Publish(eAdd(3)))
    bus.do("vanish add, abandon add, run 1")
    assert "n=3" in str(bus.algorithm.scene)


def test_a_taker_restarted_during_a_tick_receives_the_orders_again():
    bus = taking().do("start, run 1, hold up add")
    bus.handle(s.Publish(eAdd(3)))
    bus.do("frame, vanish add, release, appear add, run 1")
    assert "n=6" in str(bus.algorithm.scene)


def test_an_order_without_receivers_changes_nothing():
    bus = started()
    before = bus.algorithm.scene
    bus.do("vanish add, abandon add")
    bus.handle(s.Publish(eStep(1)))
    bus.do("settle, run 1")
    assert bus.algorithm.scene == before
    assert [str(event) for event in bus.records[-1].events] == ["eStep<count=1>"]
