"""Events that people may send: none of a generator, unless the world file allows that."""

from typing import Annotated

import pytest
from pond import Add, Steps, counters, eAdd, service, started, undisturbed
from test_orders import Taker, taking

from minerva_bus import EventType, Of, Primitive, Vocabulary, parse
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.world.norms import Norm


class Keys(Add):
    """A person adds."""

    people = True


def refusal(bus, event_type):
    return bus.algorithm.orders.refusal_of_order(event_type)


def test_types_of_generators_are_not_for_people():
    bus = started()
    said = refusal(bus, "eAdd")
    assert "eAdd comes from add, so people may not send it" in said
    assert 'people = ["eAdd"] under [world]' in said
    assert refusal(bus, "eCroak") == ""


def test_nor_is_it_while_that_generator_is_away():
    bus = started().do("vanish add, settle")
    assert "comes from add" in refusal(bus, "eAdd")
    bus.handle(s.Abandoned("add"))
    assert refusal(bus, "eAdd") == ""


def test_people_may_send_types_with_a_taker_even_if_another_generates_them():
    assert refusal(taking().do("start, run 1"), "eAdd") == ""
    also = taking(more=service("more", Taker), steps=service("steps", Steps)).do("start, run 1")
    assert refusal(also, "eAdd") == ""
    assert "comes from steps" in refusal(also, "eStep")


def test_what_norms_send_is_from_nobody_else():
    """Neither people nor an attached generator, whether it stands for people or not."""
    norms = (
        Norm("quiet", on=("eStep",), when="event.count > 9", sanction=eAdd(9)),
        Norm("held", when="n > 9"),
    )
    bus = started(norms=norms, members={"add": service("add", Steps)})
    reserved = "comes from the norm {}, so people may not send it; to let them, write people = "
    assert reserved.format("quiet") in refusal(bus, "eAdd")
    assert reserved.format("held") in refusal(bus, "eRefused")
    for name, generator in (("sensor", Add), ("keys", Keys)):
        said, _ = attached(bus, generator, name)
        assert reserved.format("quiet") in said[0], said
    allowed = started(norms=norms, people=("eAdd",))
    assert refusal(allowed, "eAdd") == ""
    assert attached(allowed, Add)[0] == []


def test_the_world_file_may_allow_it():
    bus = started(people=("eAdd",))
    assert refusal(bus, "eAdd") == ""
    bus.handle(s.Publish(eAdd(3)))
    bus.run(1)
    assert "n=5" in str(bus.algorithm.scene)


def test_before_all_members_are_present_no_result_is_known():
    bus = counters()
    assert "have not joined yet: add" in refusal(bus, "eAdd")
    assert refusal(counters(people=("eAdd",)), "eAdd") == ""


def test_nor_are_they_for_people_who_attach_a_generator():
    """The reply to its hello says why, and it may still take part in worlds that allow it."""
    bus = started()
    said, digests = attached(bus, Keys)
    assert said[:-1] == [
        "guest: may not join: eAdd comes from add, so people may not send it; to let them, write"
        ' people = ["eAdd"] under [world] in the world file, or make guest a process of it'
    ]
    assert digests == undisturbed(3)[1:]
    assert attached(bus, Steps, "other") == ([], undisturbed(5)[3:])
    allowed = started(people=("eAdd",))
    assert attached(allowed, lambda: Keys(2))[0] == []
    assert "n=7" in str(allowed.algorithm.scene)


def test_a_sensor_may_be_attached_that_makes_the_same_events_as_a_process():
    bus = started()
    assert attached(bus, lambda: Add(2))[0] == []
    assert "n=7" in str(bus.algorithm.scene)


@pytest.mark.parametrize("when", ["in step", "freely"])
def test_a_guest_that_joins_before_the_process_may_not_send_them_either(when):
    class Early(Keys, when=when):
        pass

    bus = counters()
    bus.join("guest", service("guest", Early))
    bus.do("settle, appear host, settle, appear add, settle")
    assert bus.said == []
    if when == "freely":
        bus.put(m.Emitted("guest", (eAdd(30),)))
    bus.run(2)
    assert len(bus.said) == 1
    assert "guest: broke the protocol: eAdd comes from add" in bus.said[0]
    assert bus.digests == undisturbed(2)


def test_a_guest_that_takes_orders_allows_nothing():
    class Accomplice(Steps):
        def takes_orders(self):
            return ("eAdd",)

    bus = started()
    assert attached(bus, Accomplice)[0] == []
    assert bus.algorithm.members.takers("eAdd") == ["guest"]
    assert "eAdd comes from add" in refusal(bus, "eAdd")
    assert "may not join" in attached(bus, Keys, "other")[0][0]


@pytest.mark.parametrize("people", [True, False])
def test_the_types_of_an_attached_sensor_are_not_for_people(people):
    class Guest(Steps):
        pass

    Guest.people = people
    bus = started()
    assert attached(bus, Guest)[0] == []
    assert bus.algorithm.members.get("guest").active
    assert ("eStep comes from guest" in refusal(bus, "eStep")) is not people


def attached(bus, generator, name="guest"):
    """What a world says while a guest joins and takes part in two frames, and their digests."""
    count = len(bus.said), len(bus.digests)
    bus.join(name, service(name, generator))
    bus.run(2)
    return bus.said[count[0] :], bus.digests[count[1] :]


@pytest.mark.parametrize("hands", [True, False])
def test_people_may_send_types_of_a_keyboard(hands):
    class Hands(Steps):
        people = hands

    bus = started(members={"steps": service("steps", Hands)})
    assert bool(refusal(bus, "eStep")) is not hands


def signs(string):
    eGo = EventType("eGo", to=Annotated[str, Of("PSign", "name")])
    PSign = Primitive("PSign", name=str)
    world = WorldSpec("signs", parse(string), Vocabulary.of(eGo, PSign), expected=frozenset())
    return FrameAlgorithm(world), eGo


def test_an_order_may_only_name_what_the_world_has():
    algorithm, eGo = signs('PSign<name="kitchen"> · PSign<name="store">')
    assert algorithm.orders.unknown_value(eGo("store")) == ""
    assert algorithm.orders.unknown_value(eGo("stor")) == (
        "eGo: to is 'stor', but no PSign of the world has this name; expected kitchen, store"
        "; did you mean 'store'?"
    )


def test_a_world_without_references_logs_nothing():
    algorithm, eGo = signs("")
    assert algorithm.orders.unknown_value(eGo("anywhere")) == ""
