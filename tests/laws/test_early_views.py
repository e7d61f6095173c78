"""Views that a host sends before it is asked leave strings, views and events as they are."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from belfry import ACTS, VOCABULARY, Bell, Chime, PBell, Ringer, Watcher, belfry, eRing, eShow
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.grammar.batch import single
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.runner import Sink
from minerva_bus.testing.memory_bus import MemoryBus
from minerva_bus.world.context import Frame
from minerva_bus.world.norms import Norm
from minerva_bus.world.policy import Policy

BELLS = "ABell#a · ABell#b(ABell#c) · ABell#d"
STRINGS = {"bells": BELLS, "chimes": Chime.many("c", 70), "one": "ABell#a"}
STRINGS["both"] = STRINGS["chimes"] + Bell("a").string
NORMS = {
    "none": (),
    "agents": (Norm("loud", when="rung >= 4 and rung < 7"),),
    "events": (Norm("seen", on=("eShow",), when="rung == 2"),),
}
FRAMES = 24


def drained(bus):
    if bus.algorithm.members.knows("h1"):
        bus.handle(s.Drain("h1"))


FAULTS = {
    "restart": lambda bus: bus.restart("h0"),
    "another": lambda bus: bus.restart("h1") if "h1" in bus.alive else None,
    "drain": drained,
    "successor": lambda bus: bus.kill_coordinator(),
}


class Host(Member):
    """Counts the views that it sends before it is asked."""

    def __init__(self, name: str) -> None:
        super().__init__(name, None, (Bell, Chime))


class Asked(Host):
    """A host that cannot send early views."""

    def hello(self) -> m.Hello:
        return replace(super().hello(), early_views=False)


class Early(Sink):
    """Counts early views, and the requests for views alone."""

    def __init__(self) -> None:
        self.asked = 0
        self.ahead: list[tuple[int, str]] = []

    @property
    def sent(self) -> int:
        return len(self.ahead)

    def decided(self, stimulus, instructions):
        if isinstance(stimulus, m.EvolveReply) and stimulus.ahead is not None:
            self.ahead.append((stimulus.frame, stimulus.member))
        messages = [order.message for order in instructions if isinstance(order, s.Send)]
        self.asked += sum(
            isinstance(each, m.EvolveRequest) and not each.events for each in messages
        )


def of_one_process(text, rings, **rest):
    """The records and views of a world in one process, without early views."""
    watcher, records = Watcher(), []

    def watch(notice):
        if isinstance(notice, s.FrameDone):
            records.append(notice.record)

    members = [Asked("h"), Member("ringer", Ringer(rings)), Member("watcher", watcher)]
    described = belfry(text, [member.name for member in members], frames=FRAMES, **rest)
    runner = InProcessRunner(FrameAlgorithm(described), members, watch)
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())
    return [of(record) for record in records], watcher.shown


def of(record: m.FrameRecord) -> tuple[str, ...]:
    return (record.digest.hex(), *map(str, single(record.events)))


class OnBus:
    """The same world with some hosts, in which early views are sent."""

    def __init__(self, text, rings, hosts, **rest) -> None:
        self.watcher, self.early = Watcher(), Early()
        makers = {
            **{f"h{n}": lambda n=n: Host(f"h{n}") for n in range(hosts)},
            "ringer": lambda: Member("ringer", Ringer(rings)),
            "watcher": lambda: Member("watcher", self.watcher),
        }
        self.bus = MemoryBus(belfry(text, makers, frames=FRAMES, **rest), makers, [self.early])
        self.bus.start()
        self.bus.settle()

    def run(self):
        while self.bus.ended is None:
            self.bus.frame()
        return self.result

    @property
    def result(self):
        return [of(record) for record in self.bus.records], self.watcher.shown


def rung(*acts, every=2):
    return {every * n: (eRing(act, receivers=["a"]),) for n, act in enumerate(acts)}


def test_a_view_that_follows_from_an_answer_needs_no_request():
    rings = rung(*["show"] * 12)
    world = OnBus("ABell#a", rings, 1)
    assert world.run() == of_one_process("ABell#a", rings)
    # The first two show that there is something to save.
    assert (world.early.sent, world.early.asked) == (10, 2)


def test_every_act_of_an_agent_has_the_same_strings_and_views():
    rings = rung(*[act for act in ACTS if act != "die"] * 2, every=1)
    for text in ("ABell#a", BELLS):
        assert OnBus(text, rings, 1).run() == of_one_process(text, rings)


def test_a_host_whose_views_are_void_sends_none_for_a_while():
    rings = {**rung(*["show"] * 12), 7: (eRing("quiet", receivers=["a"]),)}
    world = OnBus("ABell#a", rings, 1)
    assert world.run() == of_one_process("ABell#a", rings)
    # Frame 7 has another event; then there are to be four frames whose views would have counted.
    assert [frame for frame, _ in world.early.ahead] == [4, 6, 16, 18, 20, 22]


def test_a_host_that_has_joined_again_is_told_again():
    rings = rung(*["show"] * 12)
    world = OnBus("ABell#a", rings, 1)
    while world.bus.ended is None:
        world.bus.frame()
        if world.bus.algorithm.frame == 8:
            world.bus.restart("h0")
            world.bus.settle()
    assert world.result == of_one_process("ABell#a", rings)
    assert [frame for frame, _ in world.early.ahead] == [4, 6, 10, 12, 14, 16, 18, 20, 22]


def test_a_view_that_fails_is_an_error_only_in_a_frame_that_needs_it(monkeypatch):
    def fails(self, event):
        if self.rung == 4:
            raise ValueError("the fourth")
        return PBell(self.rung)

    monkeypatch.setitem(Bell.views, "eShow", fails)
    # The norm lets no one see the fourth.
    rings, norms = rung(*["show"] * 8), (Norm("fourth", on=("eShow",), when="rung == 4"),)
    world = OnBus("ABell#a", rings, 1, norms=norms)
    assert world.run() == of_one_process("ABell#a", rings, norms=norms)
    assert [frame for frame, _ in world.early.ahead] == [4, 12, 14]


def test_events_of_two_hosts_make_their_views_void():
    rings = {n: (eRing("show"),) for n in range(0, FRAMES, 2)} | {
        2: (eRing("show", receivers=["a"]),)
    }
    world = OnBus(BELLS, rings, 2)
    assert world.run() == of_one_process(BELLS, rings)


def test_an_outcome_that_a_norm_rejects_makes_the_views_of_its_host_void():
    rings = rung(*["show"] * 8) | {
        8: (eRing("show", receivers=["a"]), eRing("quiet", receivers=["d"]))
    }
    norms = (Norm("still", when="rung == 1 and was.rung == 0"),)
    world = OnBus("ABell#a<rung=5> · ABell#d", rings, 1, norms=norms)
    assert world.run() == of_one_process("ABell#a<rung=5> · ABell#d", rings, norms=norms)


def test_views_that_fail_leave_those_of_other_fragments_to_be_sent(monkeypatch):
    host = Host("h").host
    host.take(m.Fragments({name: VOCABULARY.read(f"ABell#{name}") for name in "ad"}))
    answer = m.EvolveReply("h", 0, emitted={"a": (replace(eShow(), sender="a"),)})
    show = Bell.views["eShow"]

    def fails(self, event):
        return show(self, event) if self.id == "a" else 1 / 0

    monkeypatch.setitem(Bell.views, "eShow", fails)
    assert host.with_views_ahead(answer, Frame(1, 0.1, 0), VOCABULARY) is answer
    monkeypatch.undo()
    request = m.EvolveRequest(1, ("h",), (), answer.emitted["a"])
    views = host.answer(request, Frame(1, 0.1, 0), Policy.SEQUENTIAL, VOCABULARY).views
    assert sorted(views["eShow"]) == ["a", "d"]


def test_views_of_a_host_that_was_not_told_break_the_protocol():
    world = OnBus("ABell#a", rung("show"), 1)
    for host in world.bus.alive.values():
        host._sends_early_views = True
    world.bus.frame()
    assert any("was not told to" in line for line in world.bus.said)


@given(st.data())
def test_strings_views_and_events_are_those_of_one_process(data):
    text = STRINGS[data.draw(st.sampled_from(sorted(STRINGS)), "string")]
    norms = NORMS[data.draw(st.sampled_from(sorted(NORMS)), "norms")]
    agents = st.sampled_from(["a", "b", "c", "d", "c1", "c69", "nobody"])
    receivers = st.just(()) | st.lists(agents, min_size=1, max_size=2, unique=True).map(tuple)
    acts = st.sampled_from(("show", "show", *ACTS))
    ring = st.builds(lambda act, to: eRing(act, receivers=list(to)), acts, receivers)
    rings = data.draw(
        st.dictionaries(
            st.integers(0, FRAMES - 1),
            st.lists(ring, min_size=1, max_size=2, unique=True).map(tuple),
            max_size=FRAMES,
        )
    )
    # Many worlds repeat what makes early views useful.
    usual = data.draw(st.sampled_from([{}, rung(*["show"] * 12), rung(*["self"] * 8, every=3)]))
    rings = {**usual, **rings}
    world = OnBus(text, rings, data.draw(st.integers(1, 3), "hosts"), norms=norms)
    at_faults = data.draw(
        st.dictionaries(st.integers(0, FRAMES), st.sampled_from(sorted(FAULTS)), max_size=3)
    )
    schedule = Random(data.draw(st.integers(0, 1000), "schedule"))
    faults = set(at_faults.values())
    while world.bus.ended is None:
        if (links := world.bus.ready()) and not world.bus.stuck:
            world.bus.step(schedule.choice(links))
        else:
            raise AssertionError(f"waits for {world.bus.stuck}")
        if fault := at_faults.pop(world.bus.algorithm.frame, None):
            FAULTS[fault](world.bus)
    frames, shown = of_one_process(text, rings, norms=norms)
    assert world.result[0] == frames
    # Views on their way are lost with a coordinator, and its successor sends the last one again.
    missing = set(shown) - set(world.watcher.shown)
    assert set(world.watcher.shown) <= set(shown)
    assert not missing or "successor" in faults
