"""Changes of the string: births, deaths, new shapes, and fragments in transit."""

import pytest
from pond import (
    VOCABULARY,
    Add,
    Bus,
    Counter,
    Fly,
    Frog,
    Lily,
    Mother,
    Screen,
    Steps,
    Tadpole,
    counters,
    eAdd,
    host,
    service,
    started,
    world,
)

from minerva_bus import Agent, Vocabulary, on
from minerva_bus.frame.world_state import WorldSpec


def test_a_newborn_receives_its_first_events_in_the_next_frame():
    bus = started("AMother#m", members={"host": host("host", Counter, Mother)}, frames=3, after=0)
    bus.do("run").expect("""
        > begin 0
        > add: ticked 0: eAdd<n=1>
            host ← fragments #m
            ~hosts ← evolve 0 on host: eAdd<n=1>
        > host: evolved 0: #m
            frame 0 is done: eAdd<n=1>; #m: AMother#m<births=1>() · ACounter#m:1<n=1>()
        > begin 1
        > add: ticked 1: eAdd<n=1>
            host ← fragments #m #m:1
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > host: evolved 1: #m #m:1
            frame 1 is done: eAdd<n=1>; #m: AMother#m<births=2>() · ACounter#m:2<n=1>(), #m:1: ACounter#m:1<n=2>()
        > begin 2
        > add: ticked 2: eAdd<n=1>
            host ← fragments #m #m:2
            ~hosts ← evolve 2 on host: eAdd<n=1>
        > host: evolved 2: #m #m:1 #m:2
            frame 2 done: eAdd<n=1>; #m: AMother#m<births=3>() · ACounter#m:3<n=1>(), #m:1: ACounter#m:1<n=3>(), #m:2: ACounter#m:2<n=2>()
            stopping
            ~all ← stop: the frames are over
        > add: report {'adders': 1, 'added': 1}
        > host: report
            ended: the frames are over {'adders': 1, 'added': 1}
        > add vanished
        > host vanished
    """)


def test_the_dead_are_gone_from_everywhere():
    bus = started(
        "ACounter#a<n=98> · ACounter#b", members={"screen": service("screen", Screen)}, after=4
    )
    assert str(bus.algorithm.scene) == "ACounter#b<n=4>()"
    assert list(bus.alive["host"].host.fragments) == ["b"]
    assert bus.alive["screen"].service.shown == [
        "0: PDot<x=98> · PDot<x=0>",
        "1: PDot<x=99> · PDot<x=1>",
        "2: PDot<x=2>",
        "3: PDot<x=3>",
    ]


def test_transformations_around_agents_stay():
    text = "PDot<x=5> · TAt<x=1>(ACounter#a<n=99> · TAt<x=2>(ACounter#b)) · PDot<x=6>"
    bus = started(text)
    assert str(bus.algorithm.scene) == (
        "PDot<x=5> · TAt<x=1>(TAt<x=2>(ACounter#b<n=1>())) · PDot<x=6>"
    )


def test_the_world_ends_with_the_empty_string():
    bus = started("ACounter#a<n=98>")
    bus.do("run").expect("""
        > begin 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > host: evolved 1: #a
            frame 1 done: eAdd<n=1>; #a:
            stopping
            ~all ← stop: the string is empty
        > add: report {'adders': 1, 'added': 1}
        > host: report
            ended: the string is empty {'adders': 1, 'added': 1}
        > add vanished
        > host vanished
    """)


def test_only_what_has_changed_travels():
    """A host that computes its fragments itself never receives them."""
    members = {"host": host("host", Counter), "steps": service("steps", Steps)}
    bus = counters(members=members).do("start, run 5")
    assert sum("host ← fragments" in line for line in bus.trace) == 1


def test_hosts_that_no_event_concerns_are_not_asked():
    members = {"frogs": host("frogs", Frog), "flies": host("flies", Fly)}
    bus = counters("ACounter#a · AFrog#f · AFly#y", members=members).do("start, run 3")
    assert [line.strip() for line in bus.trace if "evolve" in line and "←" in line] == [
        f"~hosts ← evolve {frame} on host: eAdd<n=1>" for frame in range(3)
    ]


def test_a_fragment_with_agents_of_many_kinds_goes_where_all_are_offered():
    members = {
        "lilies": host("lilies", Lily),
        "frogs": host("frogs", Frog, Counter),
        "all": host("all", Lily, Frog, Counter),
        "steps": service("steps", Steps),
    }
    bus = started("ALily#l(AFrog#f(ACounter#c))", members=members, after=2)
    assert [name for name, process in bus.alive.items() if process.host.fragments] == ["all"]
    assert "ALily#l<steps=4>" in str(bus.algorithm.scene)


def test_an_agent_that_leaves_another_s_scope_becomes_a_fragment_of_its_own():
    class Pond(Lily, symbol="ALily"):
        @on("eStep")
        def count(self, step, moment):
            self.steps += 1
            out, self.scope = self.scope, VOCABULARY.read("")
            return self.string + out

    members = {"host": host("host", Pond, Counter), "steps": service("steps", Steps)}
    bus = started("ALily#l(ACounter#c)", members=members, after=3)
    assert str(bus.algorithm.scene) == "ALily#l<steps=3>() · ACounter#c<n=3>()"


@pytest.mark.parametrize("text", ["ATadpole#t", "TAt<x=1>(ATadpole#t)", "ALily#l(ATadpole#t)"])
def test_an_agent_that_turns_into_another_kind_goes_where_that_is_offered(text):
    members = {"host": host("host", Counter), "pool": host("pool", Tadpole, Lily)}
    if "Lily" in text:
        members["all"] = host("all", Lily, Counter)
    bus = started(text, members=members, after=5)
    assert "ACounter#t<n=5>" in str(bus.algorithm.scene)


def test_a_kind_that_makes_one_id_twice_is_named():
    class Careless(Agent, symbol="AMother"):
        births: int = 0

        @on("eAdd")
        def bear(self, add, moment):
            return self.string + Counter("same").string

    bus = started("AMother#m", members={"host": host("host", Careless)}, after=5)
    assert len(bus.records) == 1
    assert "host: broke the protocol: it made a second agent #same" in bus.said
    assert bus.algorithm.waiting_for() == ["host"]


def test_one_host_or_many_give_the_same_strings():
    text = " · ".join(f"AFrog#f{n}<x={n}>" for n in range(6)) + " · ALily#l(AFly#y · AFrog#g)"
    kinds = (Frog, Fly, Lily)
    digests = []
    for count in (1, 2, 5):
        members = {f"host-{n}": host(f"host-{n}", *kinds) for n in range(count)}
        members["steps"] = service("steps", Steps)
        bus = Bus(world(text, members, frames=15, seed=3), members)
        bus.do("start, run")
        digests.append(bus.digests)
    assert digests[0] == digests[1] == digests[2]
    assert len(set(digests[0])) == 15


def test_another_seed_gives_other_strings():
    def digests(seed):
        members = {"host": host("host", Frog), "steps": service("steps", Steps)}
        bus = Bus(world("AFrog#f", members, frames=2, seed=seed), members)
        bus.do("start, run")
        return bus.digests

    assert digests(1) == digests(1)
    assert digests(1) != digests(2)


def test_without_events_nothing_is_asked_and_nothing_changes():
    class Silent(Add):
        def generate(self, tick):
            return ()

    bus = counters(members={"add": service("add", Silent)}, frames=3).do("start, run")
    assert len(set(bus.digests)) == 1
    assert not any("evolve" in line for line in bus.trace)


class Spawner(Agent, symbol="ASpawner"):
    """Is replaced by many agents at once."""

    n: int = 0

    @on("eAdd")
    def burst(self, event, moment):
        self.n += event.n
        return Spawner.many("s", 40, n=self.n) if self.id == "a" else None


@pytest.mark.parametrize("hosts", [1, 2])
def test_an_agent_may_become_many_in_columns(hosts):
    vocabulary = Vocabulary.of(eAdd, Spawner)
    members = {f"h{n}": host(f"h{n}", Spawner) for n in range(hosts)}
    members["add"] = service("add", Add)
    w = WorldSpec("spawn", vocabulary.read("ASpawner#a"), vocabulary, expected=frozenset(members))
    bus = Bus(w, members)
    bus.do("start, run 4")
    assert bus.stuck == []
    assert len(bus.digests) == 4
    assert len(bus.algorithm.scene) == 40
    assert {node.values for node in bus.algorithm.scene} == {(4,)}
