"""Placement rules are applied and reported, and do not affect the string."""

from dataclasses import replace

import pytest
from pond import VOCABULARY, Add, Bus, Counter, Minnow, Steps, host, service, world

from minerva_bus.frame import placement as load
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.messages import MemberMetrics
from minerva_bus.frame.placement import Placement, PlacementRules, Rule
from minerva_bus.frame.stimuli import Drain
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import Scene

FOUR = " · ".join(f"ACounter#{id}" for id in "abcd")


def pond(hosts, placement, text=FOUR, **rest):
    """Counters on hosts with given machines; the generator runs on the machine `lab`."""
    members = {"add": on("lab", "add", service("add", Add))}
    members |= {name: on(where, name, host(name, Counter)) for name, where in hosts.items()}
    bus = Bus(world(text, ["add"], placement=placement, **rest), members)
    bus.start()
    return bus


def on(machine, name, make):
    """A factory of a member that runs on this machine."""

    def made():
        participant = make()
        plain = participant.hello
        participant.hello = lambda: replace(plain(), about={"host": machine})
        return participant

    return made


def homes(bus):
    distribution = bus.algorithm.placement
    return {id: distribution.host_of(id) for id in bus.algorithm.composition.fragments}


def counts(bus):
    return {node.id: node.values[0] for node in bus.algorithm.scene.nodes}


def test_a_kind_lives_only_where_it_may():
    bus = pond({"east": "1", "west": "2"}, PlacementRules({"ACounter": Rule(only=("we*",))}))
    bus.run(3)
    assert set(homes(bus).values()) == {"west"}
    plain = pond({"east": "1", "west": "2"}, PlacementRules())
    plain.run(3)
    assert set(homes(plain).values()) == {"east", "west"}
    assert bus.digests == plain.digests


def test_agents_follow_the_member_that_they_have_to_be_near():
    near = PlacementRules({"ACounter": Rule(near="add")})
    bus = pond({"east": "field", "west": "lab"}, near)
    bus.run(2)
    assert set(homes(bus).values()) == {"west"}
    bus.do("vanish add, settle")
    bus.join("add", on("field", "add", service("add", Add)))
    bus.run(2)
    assert set(homes(bus).values()) == {"east"}
    assert counts(bus) == dict.fromkeys("abcd", 4)


def test_agents_beyond_the_capacity_of_hosts_stand_still():
    bus = pond({"east": "1"}, PlacementRules(agents_per_host=3))
    bus.run(2)
    assert sorted(counts(bus).values()) == [0, 2, 2, 2]
    assert [line for line in bus.said if "1 agent has no host and does not evolve" in line]
    bus.join("west", host("west", Counter))
    bus.run(1)
    assert sorted(counts(bus).values()) == [1, 3, 3, 3]
    assert "every agent has a host again" in bus.said[-1]
    assert sorted(homes(bus).values()) in (["east"] * n + ["west"] * (4 - n) for n in (1, 2, 3))


def test_it_is_reported_once_until_something_changes():
    bus = pond({"east": "1"}, PlacementRules(agents_per_host=3))
    bus.run(40)
    assert len([line for line in bus.said if "not evolve" in line]) == 1


def test_kinds_that_no_host_offers_are_named_once():
    bus = pond({}, PlacementRules(), "ACounter#a · AMinnow#m")
    bus.run(5)
    assert bus.said == [
        f"placement: no host offers {kind}: these agents do not evolve; add their class to agents, or attach a host"
        for kind in ("ACounter", "AMinnow")
    ]
    bus.join("west", host("west", Counter))
    bus.run(2)
    assert counts(bus)["a"] == 2
    bus.do("vanish west, settle, run 2")
    assert len([line for line in bus.said if "no host offers" in line]) == 2


def shoal(hosts, placement, text, **rest):
    members = {"steps": service("steps", Steps)} | {name: host(name, Minnow) for name in hosts}
    bus = Bus(world(text, members, placement=placement, seed=5, **rest), members)
    bus.start()
    return bus


MANY = " · ".join(f"AMinnow#m{n}<x={n}>" for n in range(150))


@pytest.mark.parametrize("most", [0, 100, 400])
def test_a_population_is_cut_so_that_its_parts_have_room(most):
    alone = shoal(["one"], PlacementRules(), MANY)
    alone.run(12)
    bus = shoal(["one", "two", "six"], PlacementRules(agents_per_host=most), MANY)
    bus.run(12)
    assert bus.digests == alone.digests
    if most == 100:
        parts = bus.algorithm.composition.parts
        assert len(parts) >= 2
        assert all(part.count <= 2 * most for part in parts.values())  # parts grow until divided


def test_a_slow_small_population_is_divided_after_two_frames():
    """And it is whole again at the next check if it is fast; its string is the same."""
    few = " · ".join(MANY.split(" · ")[:40])
    alone = shoal(["one"], PlacementRules(), few)
    alone.run(6)
    bus, parts = shoal(["one", "two", "six"], PlacementRules(), few), list[int]()
    for seconds in (0.3, 0.3, 0.3, 0.001, 0.001, 0.001):
        bus.run(1)
        distribution = bus.algorithm.placement
        parts.append(len(distribution.occupied))
        for name in distribution.occupied:
            distribution.note_elapsed(name, seconds)
    assert parts == [1, 1, 3, 3, 1, 1]
    assert bus.digests == alone.digests


def test_excess_rows_of_a_population_stand_still():
    bus = shoal(["one"], PlacementRules(agents_per_host=100), MANY)
    bus.run(1)
    parts = list(bus.algorithm.composition.parts.items())
    assert len(parts) == 2
    still = [name for name, _ in parts if homes(bus)[name] is None]
    assert len(still) == 1
    assert any("50 agents have no host" in line for line in bus.said)


def test_a_host_that_dies_amid_a_frame_leaves_its_string_as_it_is():
    """The other hosts take all of its agents until the frame ends, then up to the limit."""
    members = {"one": "1", "two": "1", "six": "1"}
    text = " · ".join(f"ACounter#n{n}" for n in range(9))
    plain = pond(members, PlacementRules(), text)
    plain.run(3)
    bus = pond(members, PlacementRules(agents_per_host=3), text).do("run 2, hold up two, frame")
    assert bus.algorithm.waiting_for() == ["two"]
    bus.do("release, drop up two, vanish two, settle")
    assert bus.digests == plain.digests
    bus.run(2)
    assert sorted(counts(bus).values()) == [3, 3, 3, 5, 5, 5, 5, 5, 5]


def test_agents_wait_for_the_member_near_which_they_live_to_be_attached():
    bus = pond({"east": "field"}, PlacementRules({"ACounter": Rule(near="second")}))
    bus.run(2)
    assert set(counts(bus).values()) == {0}
    bus.join("second", on("field", "second", service("second", Steps)))
    bus.run(2)
    assert set(counts(bus).values()) == {2}


def distributed(rows, most, **hosts):
    composition = Composition(VOCABULARY.read(MANY))
    assert [part.count for part in composition.parts.values()] == [150]
    composition.replace({name: Scene((part.take(slice(rows)),)) for name, part in
                         composition.parts.items()})  # fmt: skip
    distribution = Placement(VOCABULARY, composition, most)
    offers = dict.fromkeys(hosts or {"one": 0}, frozenset({"AMinnow"}))
    distribution.arrange(offers)
    return composition, distribution, offers


def sizes(composition):
    return [part.count for part in composition.parts.values()]


def test_agents_that_stood_still_continue_after_deaths():
    composition, distribution, offers = distributed(150, 100)
    assert (sizes(composition), distribution.unassigned_agents) == ([100, 50], 50)
    first, part = next(iter(composition.parts.items()))
    composition.replace({first: Scene((part.take(slice(60)),))})
    assert distribution.imbalanced
    distribution.arrange(offers)
    assert (sizes(composition), distribution.unassigned_agents) == ([100, 10], 10)


def test_births_beyond_a_hosts_capacity_move_to_others():
    composition, distribution, offers = distributed(140, 80, one=0, two=0)
    assert (sizes(composition), distribution.unassigned_agents) == ([70, 70], 0)
    first, part = next(iter(composition.parts.items()))
    rest = next(iter(Composition(VOCABULARY.read(MANY)).parts.values())).take(slice(140, 150))
    composition.replace({first: Scene((Columns.concatenated([part, rest]),))})
    distribution.arrange(offers)
    assert sizes(composition) == [80, 70]
    assert not distribution.imbalanced
    more = Columns.concatenated([composition.parts[first], _others(20)])
    composition.replace({first: Scene((more,))})
    assert distribution.imbalanced
    distribution.arrange(offers)
    assert (max(sizes(composition)[:2]), distribution.unassigned_agents) == (80, 10)


def _others(rows):
    text = " · ".join(f"AMinnow#o{n}<x={n}>" for n in range(64))
    return next(iter(Composition(VOCABULARY.read(text)).parts.values())).take(slice(rows))


def test_a_slow_host_gets_a_smaller_share(monkeypatch):
    monkeypatch.setattr(load, "_MIN_ROWS", 50)
    composition, distribution, offers = distributed(140, 0, one=0, two=0)
    first, second = composition.parts
    assert (distribution.host_of(first), distribution.host_of(second)) == ("one", "two")
    for _ in range(load.WINDOW):
        distribution.note_elapsed("one", 3.0)
        assert not distribution.imbalanced
        distribution.note_elapsed("two", 1.0)
    assert distribution.imbalanced
    distribution.arrange(offers)
    assert sizes(composition) == [35, 105]


def test_a_drained_host_gives_its_agents_to_the_others_and_keeps_its_figures():
    bus = pond({"east": "1", "west": "1"}, PlacementRules())
    bus.run(1)
    assert set(homes(bus).values()) == {"east", "west"}
    bus.handle(MemberMetrics("east", {"cached": 3}))
    bus.handle(Drain("east"))
    bus.handle(Drain("nobody"))
    bus.run(2)
    assert set(homes(bus).values()) == {"west"}
    assert sum("draining" in line for line in bus.said) == 1
    assert set(counts(bus).values()) == {3}
    assert bus.algorithm.members.get("east").figures == {"cached": 3}
