"""A mind: exactly one event for each request, decided by frames and received events only."""

from __future__ import annotations

from typing import Annotated, Literal

import pytest

from minerva_assistants.minds import MINDS, Mind, eAsk, eRemind, eReply
from minerva_assistants.minds.form import event_of, schema_of
from minerva_bus import EventType, Frame, Metres, Range, Reals, Vocabulary, evolve
from minerva_bus.errors import MisuseError

eChoice = EventType(
    "eChoice",
    action=Literal["eat", "sleep"],
    amount=Annotated[int, Range(1, 9)],
    way=tuple[Metres, ...],
    topic=str,
)
vocabulary = Vocabulary.of(*MINDS, eChoice)


class Minds:
    """A mind between frames, with the events that it has emitted."""

    def __init__(self) -> None:
        self.scene = vocabulary.read("AMind#mind")
        self.emitted = []

    def __call__(self, frame, *events):
        evolved = evolve(self.scene, events, [Mind], Frame(frame, 0.1))
        self.scene = evolved.scene
        self.emitted = [event for sent in evolved.emitted.values() for event in sent]
        return [str(event) for event in self.emitted if event.type != "eRemind"]

    @property
    def state(self):
        (node,) = self.scene
        return dict(zip(node.names, node.values, strict=True))


def asked(**more):
    return eAsk("what next?", sender="anna", receivers=["mind"], **more)


def replied(number=1, outcome="answered", content="", **more):
    return eReply(number, "anna", outcome, content, receivers=["mind"], **more)


def test_an_answer_is_an_event_of_the_requested_type():
    mind = Minds()
    assert mind(3, asked(answer="eChoice", topic="food")) == []
    data = '{"action": "eat", "amount": 2, "way": [1.5, 2.0], "topic": "food"}'
    assert mind(9, replied(content=data)) == [
        'eChoice<action="eat", amount=2, way=[1.5, 2], topic="food"> from #mind to #anna'
    ]
    assert not mind.state["requests"]


def test_a_request_has_one_end_even_if_its_answer_is_late():
    mind = Minds()
    mind(0, asked(within=0.5))
    reminder = eRemind(sender="mind", receivers=["mind"])
    for frame in range(1, 5):
        assert mind(frame, reminder) == []
        assert [event.type for event in mind.emitted] == ["eRemind"]
    assert mind(5, reminder) == [
        'eNoAnswer<reason="time", detail="no answer within 0.5 s", topic=""> from #mind to #anna'
    ]
    assert not [event for event in mind.emitted if event.type == "eRemind"]
    assert mind(6, replied(content='{"text": "eat"}', calls=1, cost=0.5)) == []
    assert mind.state["answered"] == 0
    assert mind.state["agents"] == ("anna",)
    assert mind.state["used"].tolist() == [[1, 0, 0, 0.5]]


@pytest.mark.parametrize("outcome", ["budget", "backend", "invalid"])
def test_a_failure_has_its_reason(outcome):
    mind = Minds()
    mind(0, asked(topic="food"))
    expected = f'eNoAnswer<reason="{outcome}", detail="why", topic="food"> from #mind to #anna'
    assert mind(1, replied(1, outcome, "why")) == [expected]
    assert mind(2, replied(1, outcome, "why")) == []


def test_a_cancelled_request_ends_without_an_event():
    mind = Minds()
    mind(0, asked())
    assert mind(1, replied(1, "cancelled")) == []
    assert not mind.state["requests"]


def test_an_agent_can_neither_answer_nor_end_a_request():
    mind = Minds()
    mind(0, asked(within=0.5))
    forged = eReply(1, "anna", "answered", '{"text": "?"}', sender="eve", receivers=["mind"])
    assert mind(1, forged) == []
    assert mind(9, eRemind(sender="eve")) == []
    assert len(mind.state["requests"]) == 1


def test_reminders_do_not_multiply():
    mind = Minds()
    mind(0, asked(), asked())
    mind(1, asked())
    assert mind.emitted == []
    assert mind.state["asked"] == 3


def test_the_schema_of_an_event_type():
    assert schema_of(eChoice) == {
        "type": "object",
        "properties": {
            "action": {"type": "string", "enum": ["eat", "sleep"]},
            "amount": {"type": "integer", "minimum": 1, "maximum": 9},
            "way": {"type": "array", "items": {"type": "number", "description": "in m"}},
        },
        "required": ["action", "amount", "way"],
        "additionalProperties": False,
    }
    with pytest.raises(MisuseError, match=r"eGrid\.cells is a matrix"):
        schema_of(EventType("eGrid", cells=Reals))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("let me think", "expected a JSON object, not 'let me think'"),
        ("{", "expected a JSON object"),
        ("[1]", "expected a JSON object"),
        ('{"action": "fly", "amount": 1, "way": []}', "one of eat, sleep"),
        ('{"action": "eat", "amount": 99, "way": []}', "from 1 to 9"),
        ('{"action": "eat", "amount": 1}', "needs a value for way"),
        ('{"action": "eat", "amount": 1, "way": [], "speed": 3}', "has no speed"),
        ('{"action": "eat", "amount": NaN, "way": []}', "amount"),
        ('{"action": null, "amount": 1, "way": []}', "action"),
        ('{"a": ' + "[" * 5000 + "]" * 5000 + "}", "JSON"),
    ],
)
def test_an_invalid_answer_has_a_reason(text, reason):
    with pytest.raises(MisuseError) as raised:
        event_of(eChoice, text, "")
    assert reason in str(raised.value)


def test_an_answer_may_have_text_around_it():
    event = event_of(
        eChoice, 'Yes:\n```json\n{"action": "eat", "amount": 1, "way": [2]}\n```', "food"
    )
    assert str(event) == 'eChoice<action="eat", amount=1, way=[2], topic="food">'
