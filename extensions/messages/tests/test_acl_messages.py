"""The 22 acts, the parameters of a message, and KQML."""

from typing import Literal

import numpy as np
import pytest

from minerva_bus import Default, Event, EventType, Ids, MinervaError, Vocabulary
from minerva_bus.errors import MisuseError, VocabularyError
from minerva_bus.grammar.types import parse_type, type_of
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary
from minerva_messages import MESSAGES, OUTSIDE, Act, eMessage, reply
from minerva_messages.acts import ACTS
from minerva_messages.kqml import NEAREST, act_of, performative_of

VOCABULARY = Vocabulary.of(*MESSAGES, *OUTSIDE)

LIBRARY = [
    "accept-proposal",
    "agree",
    "cancel",
    "cfp",
    "confirm",
    "disconfirm",
    "failure",
    "inform",
    "inform-if",
    "inform-ref",
    "not-understood",
    "propagate",
    "propose",
    "proxy",
    "query-if",
    "query-ref",
    "refuse",
    "reject-proposal",
    "request",
    "request-when",
    "request-whenever",
    "subscribe",
]


def test_there_are_the_22_acts_of_the_library():
    assert list(ACTS) == LIBRARY
    assert len(ACTS) == 22


@pytest.mark.parametrize("act", ACTS)
def test_each_act_makes_a_message(act):
    message = eMessage(act, sender="a", receivers=["b"])
    assert VOCABULARY.check_event(message) == message
    assert message.performative == act
    assert type(eMessage(Act(act)).performative) is str


def test_no_other_act_gets_in():
    with pytest.raises(MisuseError, match=r"performative must be one of .* did you mean 'propose'"):
        eMessage("propse")
    smuggled = Event("eMessage", eMessage.fields.names, ("shout", *eMessage("inform").values[1:]))
    with pytest.raises(VocabularyError, match="not 'shout'"):
        VOCABULARY.check_event(smuggled)


def test_the_parameters_are_those_of_fipa():
    assert eMessage.fields.names == (
        *("performative", "content", "language", "encoding", "ontology", "protocol"),
        *("conversation_id", "reply_with", "in_reply_to", "reply_to", "reply_by"),
    )


def test_a_reply_returns_with_its_conversation():
    message = eMessage(
        "request",
        "x",
        protocol="fipa-request",
        language="minerva",
        conversation_id="a/1",
        reply_with="q",
        sender="a",
        receivers=["b"],
    )
    answer = reply(message, "agree", "yes")
    assert answer == eMessage(
        "agree",
        "yes",
        protocol="fipa-request",
        language="minerva",
        conversation_id="a/1",
        in_reply_to="q",
        receivers=["a"],
    )
    elsewhere = eMessage("request", reply_to=("c", "d"), sender="a")
    assert reply(elsewhere, Act.REFUSE).receivers == ("c", "d")


def test_a_message_without_sender_cannot_be_answered():
    with pytest.raises(MisuseError, match="neither sender nor reply_to"):
        reply(eMessage("inform"), "agree")


# --- typed content --------------------------------------------------------------------------------


def test_words_are_a_type_of_the_language():
    kind = type_of(Literal["red", "green"])
    assert str(kind) == "text red|green"
    assert parse_type("text red|green") == kind
    assert kind.fit("red") == "red"
    assert str(type_of(tuple[Literal["a", "b"], ...])) == "list of text a|b"


@pytest.mark.parametrize("bad", ["text a b|c", "text a||b", "text a|a", "text a|b c"])
def test_invalid_arguments(bad):
    with pytest.raises(MinervaError):
        parse_type(bad)


def test_words_travel_with_the_vocabulary():
    eLight = EventType("eLight", color=Default(Literal["red", "green"], "red"))
    vocabulary = Vocabulary.of(eLight, *MESSAGES)
    again = read_vocabulary(plain_vocabulary(vocabulary))
    assert again.events["eLight"].fields == eLight.fields
    with pytest.raises(VocabularyError, match="one of red, green"):
        again.check_event(Event("eLight", ("color",), ("blue",)))


def test_columns_have_none_but_the_words():
    eLight = EventType("eLight", color=Literal["red", "green"])
    wider = EventType("eLight", color=str)
    to = Ids.numbered("a", range(2))
    lights = eLight(np.array(["red", "green"], object), receivers=to)
    assert Vocabulary.of(eLight).check_events(lights) is lights
    with pytest.raises(MisuseError, match="one of red, green, not 'blue'"):
        eLight(np.array(["red", "blue"], object), receivers=to)
    with pytest.raises(VocabularyError, match="one of red, green, not 'blue'"):
        Vocabulary.of(eLight).check_events(wider("blue", receivers=to))


# --- KQML -----------------------------------------------------------------------------------------


def test_each_performative_of_kqml_has_its_place():
    assert len(NEAREST) == 36
    assert act_of("ask-if") is Act.QUERY_IF
    assert act_of("eos") is None
    with pytest.raises(MisuseError, match="did you mean 'achieve'"):
        act_of("acheive")


def test_the_way_back_leads_to_the_same_act_where_there_is_one():
    for act in Act:
        performative = performative_of(act)
        assert performative is None or performative in NEAREST
    back = {p for p, act in NEAREST.items() if act is not None and performative_of(act) == p}
    assert back == {
        *("achieve", "ask-if", "ask-one", "broadcast", "broker-one", "deny", "discard"),
        *("error", "sorry", "subscribe", "tell"),
    }
    with pytest.raises(MisuseError, match="did you mean 'inform'"):
        performative_of("infrom")
