"""The interaction protocols: messages sent, received and not understood."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus import EMPTY, Context, EventType, Frame, Vocabulary, evolve, on
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import agents
from minerva_messages import (
    CONTRACT_NET,
    MESSAGES,
    PROPOSE,
    QUERY,
    REQUEST,
    SUBSCRIBE,
    Conversations,
    Outside,
    Role,
    Talker,
    eMessage,
)
from minerva_messages.acts import ACTS
from minerva_messages.protocols import PROTOCOLS, START

eStep = EventType("eStep")


class Person(Talker, symbol="APerson"):
    """Records messages and the state of the conversation after each."""

    notes: tuple[str, ...] = ()

    @on("eStep")
    def step(self, step, moment):
        for talk in self.expire(moment):
            self.notes += (f"{talk.peer} {talk.state}",)

    def received(self, message, conversation, moment):
        state = conversation.state if conversation else "-"
        self.notes += (f"{message.performative} {state}",)


VOCABULARY = Vocabulary.of(*MESSAGES, eStep, Person)


class Two:
    """Agents a (the initiator) and b; events of one reach the other in the next frame."""

    def __init__(self):
        self.people = {name: Person(name) for name in "ab"}
        self.frame = 0
        self.waiting = []

    def moment(self, name):
        return Context(Frame(self.frame), f"#{name}")

    def open(self, protocol, **more):
        moment = self.moment("a")
        self.id = self.people["a"].open(moment, protocol, ["b"], **more)
        self.waiting += moment.emitted

    def say(self, name, act, content="", **more):
        moment, other = self.moment(name), "ba"[name == "b"]
        conversation = self.people[name].conversation(self.id, other)
        self.people[name].say(moment, conversation, act, content, **more)
        self.waiting += moment.emitted

    def pass_on(self, *extra):
        """Run one frame: deliver the waiting events and `extra`."""
        self.frame += 1
        events, self.waiting = [*self.waiting, *extra], []
        scene = self.people["a"].string + self.people["b"].string
        done = evolve(scene, events, [Person], Frame(self.frame))
        VOCABULARY.check(done.scene)
        self.people = {node.id: Person.thaw(node) for node in agents(done.scene)}
        for events in done.emitted.values():
            self.waiting += events

    def state(self, name):
        conversation = self.people[name].conversation(self.id, "ba"[name == "b"])
        return conversation.state if conversation else ""

    def notes(self, name):
        return self.people[name].notes


WAYS = {
    REQUEST: {
        "refuse": "refused",
        "agree inform": "done",
        "agree failure": "failed",
        "inform": "done",
    },
    QUERY: {"inform": "answered", "agree inform": "answered", "refuse": "refused"},
    CONTRACT_NET: {
        "refuse": "refused",
        "propose >reject-proposal": "rejected",
        "propose >accept-proposal inform": "done",
        "propose >accept-proposal failure": "failed",
    },
    SUBSCRIBE: {
        "refuse": "refused",
        "agree inform inform failure": "failed",
        "agree inform >cancel inform": "cancelled",
        "agree >cancel failure": "not-cancelled",
    },
    PROPOSE: {"accept-proposal": "accepted", "reject-proposal": "rejected"},
}


@pytest.mark.parametrize(
    ("protocol", "way", "end"),
    [(p, way, end) for p, ways in WAYS.items() for way, end in ways.items()],
    ids=lambda value: getattr(value, "name", value),
)
def test_the_ways_through_a_protocol(protocol, way, end):
    two = Two()
    two.open(protocol)
    two.pass_on()
    for act in way.split():
        two.say("a" if act[0] == ">" else "b", act.removeprefix(">"))
        two.pass_on()
    heard = "b" if act[0] == ">" else "a"
    assert two.notes(heard)[-1] == f"{act.removeprefix('>')} {end}"
    assert two.state("a") == two.state("b") == ""
    assert two.people["a"].talks == two.people["b"].talks == EMPTY


def test_the_acts_that_begin():
    assert [protocol.opening for protocol in PROTOCOLS.values()] == [
        *("request", "query-if", "cfp", "subscribe", "propose")
    ]
    two = Two()
    two.open(QUERY, act="query-ref")
    assert two.waiting[0].performative == "query-ref"


# --- not understood -------------------------------------------------------------------------------


def test_an_act_that_is_not_allowed_is_answered_and_ends_it():
    two = Two()
    two.open(REQUEST)
    two.pass_on()
    wrong = eMessage(
        "propose", protocol="fipa-request", conversation_id=two.id, sender="b", receivers=["a"]
    )
    two.pass_on(wrong)
    assert two.notes("a") == ("propose not-understood",)
    (answer,) = two.waiting
    assert (answer.performative, answer.receivers) == ("not-understood", ("b",))
    assert answer.content == "propose where fipa-request is requested"
    two.pass_on()
    assert two.notes("b")[-1] == "not-understood not-understood"
    assert two.waiting == []
    assert two.state("a") == two.state("b") == ""


@pytest.mark.parametrize(
    ("parameters", "why"),
    [
        ({"protocol": "fipa-dance"}, "there is no protocol fipa-dance here"),
        (
            {"protocol": "fipa-request", "conversation_id": "x"},
            "agree where no fipa-request x is under way",
        ),
    ],
)
def test_an_act_outside_a_protocol_is_not_understood(parameters, why):
    two = Two()
    two.pass_on(eMessage("agree", sender="a", receivers=["b"], **parameters))
    (answer,) = two.waiting
    assert (answer.performative, answer.content) == ("not-understood", why)
    assert two.notes("b") == ()
    two.pass_on()
    assert two.notes("a") == ("not-understood -",)
    assert two.waiting == []


def test_not_understood_is_never_answered():
    two = Two()
    two.open(REQUEST)
    two.pass_on()
    given = {"conversation_id": two.id, "sender": "b", "receivers": ["a"]}
    two.pass_on(eMessage("not-understood", protocol="fipa-query", **given))
    assert two.notes("a") == ("not-understood not-understood",)
    two.pass_on(eMessage("not-understood", protocol="fipa-request", **given))
    assert two.notes("a")[1:] == ("not-understood -",)
    assert two.waiting == []


def test_a_stranger_cannot_speak_in_a_conversation():
    two = Two()
    two.open(REQUEST)
    stranger = eMessage(
        "agree", protocol="fipa-request", conversation_id=two.id, sender="c", receivers=["a"]
    )
    two.pass_on(stranger)
    assert two.state("a") == "requested"
    assert [message.receivers for message in two.waiting] == [("c",)]


def test_messages_without_a_protocol_are_the_agents_own_business():
    two = Two()
    two.pass_on(
        eMessage("inform", sender="a", receivers=["b"]),
        eMessage("request", protocol="fipa-request", receivers=["b"]),
    )
    assert set(two.notes("b")) == {"inform -", "request -"}
    assert two.waiting == []


def test_a_broadcast_does_not_reach_its_sender():
    two = Two()
    two.pass_on(eMessage("inform", sender="a"))
    assert (two.notes("a"), two.notes("b")) == ((), ("inform -",))


def test_own_agents_receive_not_understood():
    two = Two()
    two.open(CONTRACT_NET)
    two.pass_on()
    with pytest.raises(MisuseError, match=r"fipa-contract-net a/1 with #a is called: .* agree by"):
        two.say("b", "agree")
    with pytest.raises(MisuseError, match="did you mean 'propose'"):
        two.say("b", "propse")
    call = two.people["b"].conversation(two.id, "a")
    two.say("b", "refuse")
    with pytest.raises(MisuseError, match="is expired"):
        two.people["b"].say(two.moment("b"), call, "propose")
    with pytest.raises(MisuseError, match="at least one"):
        two.people["a"].open(two.moment("a"), REQUEST, ["a"])
    with pytest.raises(MisuseError, match="cannot begin with agree"):
        two.people["a"].open(two.moment("a"), REQUEST, ["b"], act="agree")


# --- deadlines ------------------------------------------------------------------------------------


def test_an_answer_counts_up_to_the_frame_of_the_deadline():
    for late in (0, 1):
        two = Two()
        two.open(REQUEST, reply_by=3)
        two.pass_on()
        for _ in range(1 + late):
            two.pass_on()
        two.say("b", "agree")
        two.pass_on()
        assert two.frame == 3 + late
        assert two.notes("a") == (("agree agreed",), ("agree expired",))[late]
        if late:
            assert two.waiting[0].content == "too late"


def test_silence_ends_with_the_deadline():
    two = Two()
    two.open(REQUEST, reply_by=2)
    for _ in range(3):
        assert two.notes("a") == ()
        two.pass_on(eStep())
    assert two.notes("a") == ("b expired",)
    assert two.notes("b") == ("request requested", "a expired")
    assert two.people["a"].talks == two.people["b"].talks == EMPTY


@pytest.mark.parametrize("dropped", [False, True])
def test_a_late_bid_is_rejected(dropped):
    two = Two()
    two.open(CONTRACT_NET, reply_by=2)
    two.pass_on()
    two.frame = 4
    two.say("b", "propose", "7")
    two.pass_on(*([eStep(receivers=["a"])] if dropped else []))
    (answer,) = two.waiting
    assert (answer.performative, answer.content) == ("reject-proposal", "too late")
    two.pass_on()
    assert two.notes("b")[-1] == "reject-proposal rejected"


# --- laws -----------------------------------------------------------------------------------------

messages = st.builds(
    eMessage,
    st.sampled_from(ACTS),
    st.text(max_size=3),
    protocol=st.sampled_from(["", "fipa-x", *PROTOCOLS]),
    conversation_id=st.sampled_from(["", "a/1", "b/1", "c/1"]),
    reply_to=st.sampled_from([(), ("a",), ("z",)]),
    reply_by=st.integers(-2, 6),
    sender=st.sampled_from(["", "a", "b", "c"]),
    receivers=st.sampled_from([(), ("a",), ("b",), ("a", "b")]),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.lists(messages, max_size=4), max_size=6))
def test_no_message_breaks_an_agent(frames):
    two = Two()
    two.open(CONTRACT_NET, reply_by=3)
    for events in frames:
        two.pass_on(*events, eStep())
    for name in "ab":
        for talk in Conversations(two.people[name].talks):
            assert talk.state in PROTOCOLS[talk.protocol].turns


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(PROTOCOLS)), st.data())
def test_both_sides_agree_on_where_they_stand(name, data):
    two, protocol = Two(), PROTOCOLS[name]
    two.open(protocol)
    two.pass_on()
    for _ in range(6):
        assert two.state("a") == two.state("b")
        if not two.state("a"):
            break
        may = [
            (who, act)
            for who, role in (("a", Role.INITIATOR), ("b", Role.PARTICIPANT))
            for act in ACTS
            if protocol.after(two.state("a"), role, act)
        ]
        two.say(*data.draw(st.sampled_from(may)))
        two.pass_on()
    assert all("not-understood" not in note or " not-understood" in note for note in two.notes("a"))


@pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=sorted(PROTOCOLS))
def test_every_state_leads_to_an_end(protocol):
    for state in protocol.turns:
        assert not protocol.ends(state)
        reached, before = {state}, set()
        while reached != before:
            before = set(reached)
            reached |= {
                after
                for state in before
                for role in Role
                for act in ACTS
                if (after := protocol.after(state, role, act))
            }
        assert any(protocol.ends(state) for state in reached), state
    assert START in protocol.turns


# --- external agents ------------------------------------------------------------------------------


def test_an_outside_agent_keeps_the_messages_of_a_frame():
    scene = Outside("o").string
    messages = [eMessage("inform", str(n), sender="a", receivers=["o"]) for n in range(2)]
    scene = evolve(scene, [*messages, eMessage("inform", sender="o")], [Outside], Frame(4)).scene
    (node,) = agents(scene)
    assert [
        (message.parameters["frame"], message.parameters["content"])
        for message in node.state["mail"]
    ] == [
        (4, "0"),
        (4, "1"),
    ]
    scene = evolve(scene, [eMessage("agree", sender="a")], [Outside], Frame(6)).scene
    (node,) = agents(scene)
    assert [message.parameters["performative"] for message in node.state["mail"]] == ["agree"]
