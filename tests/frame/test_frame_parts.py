"""Parts of the frame algorithm: member states, placement, pace and composition of strings."""

import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, given, settings

from minerva_bus import EMPTY, Scene
from minerva_bus.frame import member_table as member_states
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.evolution_step import claim_ids
from minerva_bus.frame.member_table import (
    MAX_DEPARTED,
    TRANSITIONS,
    MemberChange,
    MemberEntry,
    Members,
    MemberState,
    incompatibility,
)
from minerva_bus.frame.messages import PROTOCOL_VERSION, Hello
from minerva_bus.frame.placement import place
from minerva_bus.frame.view_streams import ViewStream
from minerva_bus.frame.world_state import FrameResult
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.scene import AgentNode, agents, fill, scene_of
from minerva_bus.grammar.types import Type, Unfit
from minerva_bus.runtime.pace import Pace
from minerva_bus.runtime.timeouts import Deadlines, Patience, Waits
from minerva_bus.testing.strategies import ids
from minerva_bus.world.services import Participation, When
from tests.family import FAMILY, FAMILY_VOCABULARY, Mortal, family_strings

law = settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
read = FAMILY_VOCABULARY.read


# --- members ---------------------------------------------------------------------------------


def test_departed_members_are_listed_up_to_a_limit():
    members = Members(["home"])

    def comes(name):
        guest = members.get(name)
        members.change(guest, MemberChange.APPEARED)
        members.change(guest, MemberChange.ADMITTED)
        return guest

    comes("stays")
    returns = comes("returns")
    members.change(returns, MemberChange.WENT)
    members.saved["guest-0"] = {"much": 1}
    for number in range(MAX_DEPARTED):
        members.change(comes(f"guest-{number}"), MemberChange.WENT)
        if not number:
            comes("returns")
    assert len(list(members)) == MAX_DEPARTED + 3
    members.change(comes("last"), MemberChange.WENT)
    names = {member.name for member in members}
    assert {"home", "stays", "returns", "guest-1", "last"} <= names
    assert "guest-0" not in names
    assert not members.saved
    assert members.get("guest-0").state is MemberState.LEFT
    assert len(list(members)) == MAX_DEPARTED + 3


@pytest.mark.parametrize(("state", "change"), list(product(MemberState, MemberChange)))
def test_a_member_moves_by_the_table_and_not_otherwise(state, change):
    member = MemberEntry("m", state=state)
    moved = member.change(change)
    assert moved is ((state, change) in TRANSITIONS)
    assert member.state is TRANSITIONS.get((state, change), state)


@given(st.lists(st.sampled_from(MemberChange), max_size=30), st.booleans())
def test_one_takes_part_or_is_awaited_but_never_both(changes, expected):
    member = MemberEntry(
        "m", expected=expected, state=MemberState.LOST if expected else MemberState.LEFT
    )
    for change in changes:
        member.change(change)
        assert not (member.active and member.awaited)
        assert expected or not member.awaited


def test_every_state_can_be_reached_and_left():
    reached = {MemberState.LEFT}
    for _ in MemberState:
        reached |= {after for (before, _), after in TRANSITIONS.items() if before in reached}
    assert reached == set(MemberState)
    assert {before for before, _ in TRANSITIONS} == set(MemberState)


def test_the_drawing_of_the_table_has_all_states():
    drawn = set(re.findall(r"[A-Z]{4,}", member_states.__doc__))
    assert drawn == {state.name for state in MemberState}
    assert Path(member_states.__file__).exists()


def test_members_are_sorted_by_name_not_arrival():
    members = Members(["z", "m"])
    for name in ("q", "a"):
        member = members.get(name)
        members.change(member, MemberChange.APPEARED)
    assert [member.name for member in members] == ["a", "m", "q", "z"]
    assert [member.name for member in members.index.awaited] == ["m", "z"]


KINDS = tuple(cls.kind for cls in FAMILY)


@pytest.mark.parametrize(("hello", "reason"), [
    (Hello("m", PROTOCOL_VERSION, kinds=KINDS, generates=("eHit",), draws=("eShow",), when=When(Participation.FREELY, every=1)), ""),
    (Hello("m", PROTOCOL_VERSION + 1), f"it speaks protocol {PROTOCOL_VERSION + 1}"),
    (Hello("m", PROTOCOL_VERSION, generates=("eHitt",)), "no event type eHitt; did you mean 'eHit'?"),
    (Hello("m", PROTOCOL_VERSION, orders=("eNo",)), "no event type eNo"),
    (Hello("m", PROTOCOL_VERSION, draws=("eNo",)), "no event type eNo"),
    (Hello("m", PROTOCOL_VERSION, draws=("eHit",)), "draws eHit, which is not visual; expected one of"),
    (Hello("m", PROTOCOL_VERSION, draws=("eMark",), when=When(every=2)), "cannot be the source of eMark"),
    (Hello("m", PROTOCOL_VERSION, draws=("eMark",)), ""),
    (Hello("m", PROTOCOL_VERSION, kinds=(replace(KINDS[0], subscribes=frozenset({"eOld"})),)),
     f"its {KINDS[0].name} responds to (eOld), the world's "),
    (Hello("m", PROTOCOL_VERSION, kinds=(replace(KINDS[0], views=frozenset()),)),
     f"its {KINDS[0].name} has views for (nothing), the world's "),
])  # fmt: skip
def test_permission_to_join(hello, reason):
    reason_given = incompatibility(hello, FAMILY_VOCABULARY)
    assert reason in reason_given
    assert bool(reason_given) is bool(reason)


def test_an_objection_names_the_type_and_the_difference():
    kind = KINDS[0]
    name = kind.fields.names[0]
    first = replace(kind.fields.all[0], type=Type("text", words=("other",)), default=None)
    other = replace(kind, fields=Fields((first, *kind.fields.all[1:])))
    said = incompatibility(Hello("m", PROTOCOL_VERSION, kinds=(other,)), FAMILY_VOCABULARY)
    assert said.startswith(f"{name} of its {kind.name} is text other, of the world's ")
    assert str(kind.fields.all[0].type) in said
    fewer = replace(kind, fields=Fields(kind.fields.all[1:]))
    said = incompatibility(Hello("m", PROTOCOL_VERSION, kinds=(fewer,)), FAMILY_VOCABULARY)
    assert f"its {kind.name} has the state (" in said


@pytest.mark.parametrize(
    ("guest", "then", "on_failure", "said"),
    [
        (False, "restart", "restart", "it will be restarted in 29 s"),
        (False, "restart", "stop", "it will be killed, and the world stops, in 29 s"),
        (
            False,
            "restart",
            "ignore",
            "it will be killed, and the world continues without it, in 29 s",
        ),
        (True, "restart", "", "it will be removed in 29 s; attach it again where it runs"),
        (True, "skip", "", "the frame continues without it in 29 s"),
        (True, "stop", "", "the world stops in 29 s"),
    ],
)
def test_the_announced_policy_for_a_silent_member_is_applied(guest, then, on_failure, said):
    own = {} if guest else {"m": on_failure}
    waits = Waits(Deadlines(Patience(1.0, 30.0, then), on_failure=own))
    waits.update("step", True, ["m"], 0.0)
    waits.update("step", True, ["m"], 1.0)
    [(who, text)] = waits.describe(waits.reportable(1.0), ["m"] if guest else [], 1.0)
    assert (who, text) == ("m", f"it for 1.0 s; {said}")


# --- placement -------------------------------------------------------------------------------

hosts = st.lists(ids(), min_size=1, max_size=6, unique=True)


@law
@given(ids(), hosts, st.randoms())
def test_a_place_does_not_depend_on_the_order_of_hosts(agent, names, chance):
    shuffled = list(names)
    chance.shuffle(shuffled)
    assert place(agent, names) == place(agent, shuffled)


@law
@given(st.lists(ids(), max_size=40, unique=True), hosts, ids())
def test_only_what_goes_to_the_newcomer_moves(names, hosts, newcomer):
    for agent in names:
        after = place(agent, [*hosts, newcomer])
        assert after in (place(agent, hosts), newcomer)


def test_agents_spread_over_hosts():
    names = [f"a{n}" for n in range(1000)]
    counts = [sum(place(name, ["h1", "h2", "h3", "h4"]) == host for name in names)
              for host in ("h1", "h2", "h3", "h4")]  # fmt: skip
    assert min(counts) > 180
    assert place("a", []) is None


# --- pace ------------------------------------------------------------------------------------


def test_frames_are_due_in_rhythm():
    pace = Pace(10.0)
    assert [round(pace.due(now), 6) for now in (5.0, 5.01, 5.15, 5.2)] == [5.0, 5.1, 5.2, 5.3]


def test_after_a_late_frame_the_rhythm_restarts():
    pace = Pace(10.0)
    assert [pace.due(now) for now in (5.0, 7.0, 7.0)] == [5.0, 7.0, 7.1]


def test_without_a_rate_every_frame_is_due_at_once():
    assert [Pace(0.0).due(now) for now in (1.0, 9.0)] == [1.0, 9.0]


@law
@given(st.floats(0.5, 1000), st.lists(st.floats(0, 10), max_size=30))
def test_two_frames_are_never_due_closer_than_a_period_unless_one_was_late(rate, pauses):
    pace, now, last = Pace(rate), 0.0, None
    for pause in pauses:
        due = pace.due(now)
        assert last is None or due >= last + 1 / rate - 1e-9
        last, now = due, max(now, due) + pause


# --- composition of strings ------------------------------------------------------------------


@law
@given(family_strings())
def test_a_string_taken_apart_and_put_together_is_the_same(w):
    composition = Composition(w)
    assert composition.scene == w
    parts = {id: scene_of(node) for id, node in composition.fragments.items()}
    assert fill(composition.skeleton, parts) == w
    assert set(composition.agents()) == {agent.id for agent in agents(w)}
    for agent in agents(w):
        home = composition.fragments[composition.home(agent.id)]
        assert agent.id in {inner.id for inner in agents(scene_of(home))}
        assert composition.kind(agent.id) == agent.symbol


@law
@given(family_strings(), family_strings(), st.randoms())
def test_replacing_equals_writing_the_whole_file(w, other, chance):
    composition = Composition(w)
    free = [
        node for node in other if not (isinstance(node, AgentNode) or list(agents(scene_of(node))))
    ]
    changes = {
        id: chance.choice([EMPTY, Scene(tuple(free)), scene_of(*free, node)])
        for id, node in composition.fragments.items()
        if chance.random() < 0.6
    }
    parts = {id: scene_of(node) for id, node in composition.fragments.items()}
    wanted = fill(composition.skeleton, parts | changes)
    composition.replace(changes)
    assert composition.scene == wanted
    assert composition.scene == Composition(wanted).scene
    assert composition.fragments.keys() == Composition(wanted).fragments.keys()


@pytest.mark.parametrize(("before", "changes", "another"), [
    ("AMortal#a", {"a": "AMortal#a<energy=5>"}, False),
    ("AMortal#a", {}, False),
    ("AMortal#a", {"a": ""}, True),
    ("AMortal#a", {"a": "PGrave"}, True),
    ("AMortal#a", {"a": "AMortal#a · AMortal#b"}, True),
    ("AMortal#a", {"a": "TShift<x=1>(AMortal#a)"}, True),
    ("AMortal#a", {"a": "AWalker#a"}, True),
    ("AWalker#a(AMortal#b)", {"a": "AWalker#a"}, True),
    ("AWalker#a", {"a": "AWalker#a(AMortal#b)"}, True),
])  # fmt: skip
def test_whether_the_skeleton_is_another(before, changes, another):
    composition = Composition(read(before))
    old = composition.skeleton
    assert composition.replace({id: read(text) for id, text in changes.items()}) is another
    assert (composition.skeleton is old) is not another


TWINS = {
    "beside": ({"a": "AMortal#a · AMortal#b"}, {}, "b"),
    "within": ({"a": "AWalker#a(AMortal#b)"}, {}, "b"),
    "moved": ({"a": "AMortal#b", "b": ""}, {}, "b"),
    "an agent in columns": ({"a": "AMortal#a · AMortal#f3"}, {}, "f3"),
    "columns and an agent": ({"f": ["f0", "b"]}, {}, "b"),
    "another part": ({"f": ["f0", "g1"]}, {}, "g1"),
    "in another order": ({"f": ["g1", "f2", "f1"]}, {}, "g1"),
    "an agent to columns": ({"a": ["a", "g1"]}, {}, "g1"),
    "two newborns": ({"a": "AMortal#a · AMortal#n"}, {"b": "AMortal#b · AMortal#n"}, "n"),
    "two newborns in columns": ({"f": ["f0", "n"]}, {"g": ["g0", "n"]}, "n"),
    "two in one reply": ({"f": ["f0", "n"], "g": ["g0", "n"]}, {}, "n"),
    "first an agent": ({"a": "AMortal#a · AMortal#n"}, {"f": ["f0", "n"]}, "n"),
    "first columns": ({"f": ["f0", "n"]}, {"a": "AMortal#a · AMortal#n"}, "n"),
}  # fmt: skip


@pytest.mark.parametrize("how", TWINS)
def test_an_id_belongs_to_one_fragment_in_a_frame(how):
    first, second, twin = TWINS[how]
    parts = Mortal.many("f", 4) + read("PGrave") + Mortal.many("g", 4)
    composition, result = Composition(read("AMortal#a · AMortal#b") + parts), FrameResult()
    names = dict(zip("fg", composition.parts, strict=True))

    def claimed(changes):
        changed = {
            names.get(name, name): read(new) if isinstance(new, str) else Mortal.many(new)
            for name, new in changes.items()
        }
        claim_ids(changed, result, composition)

    claimed({"a": "AMortal#a", "g": ["g1", "g0"], "f": ["f2", "f9"]})
    result = FrameResult()
    if second:
        claimed(first)
    noted = dict(result.newborns), list(result.born)
    with pytest.raises(Unfit, match=f"a second agent #{twin}$"):
        claimed(second or first)
    assert (result.newborns, result.born) == noted
    if second:  # The same agents of the same fragment, as after a norm's refusal.
        claimed(first)


# --- views -----------------------------------------------------------------------------------


def test_deltas_add_up_to_the_whole():
    skeleton, dot = read("AMortal#a · AMortal#b"), read("PDot<size=1>")
    showing = ViewStream("eShow")
    alive = {"a", "b"}
    first = showing.next(0, skeleton, {"a": dot}, alive)
    assert (first.sequence, first.skeleton, first.parts) == (1, skeleton, {"a": dot})
    second = showing.next(1, skeleton, {"b": dot}, alive)
    assert (second.sequence, second.skeleton, second.parts) == (2, None, {"b": dot})
    assert showing.keyframe().parts == {"a": dot, "b": dot}
    assert showing.keyframe().sequence == 2


def test_the_dead_are_forgotten_with_their_skeleton():
    dot, showing = read("PDot<size=1>"), ViewStream("eShow")
    showing.next(0, read("AMortal#a · AMortal#b"), {"a": dot, "b": dot}, {"a", "b"})
    whole = showing.next(1, read("AMortal#b"), {}, {"b"})
    assert whole.parts == {"b": dot}
    assert whole.skeleton is not None


@law
@given(family_strings(), st.lists(ids(), max_size=4))
def test_the_fragments_of_many_agents_are_those_of_each(w, others):
    composition = Composition(w)
    asked = [*(agent.id for agent in agents(w)), *others, "x" * 1_000]
    homes = {agent: composition.home(agent) for agent in asked}
    expected = {agent: home for agent, home in homes.items() if home is not None}
    assert composition.home_of_each(asked) == expected
