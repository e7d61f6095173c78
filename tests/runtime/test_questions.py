"""Questions that arrive faster than they are answered."""

from types import SimpleNamespace
from typing import Any

import pytest

from minerva_bus.runtime.admission import Admission, ListenConfig
from minerva_bus.runtime.questions import Answers
from minerva_bus.runtime.session import REAL
from minerva_bus.wire.keys import Keys, who_asks
from minerva_bus.wire.plain import Limits, pack, unpack
from tests.simulator.sessions import Query

STATUS = pack({"ask": "status"})


@pytest.fixture
def asked():
    """A function that asks on a key and returns whether it was admitted; replies; and answers."""
    limits, replies = Limits(questions=2), list[Any]()
    algorithm = SimpleNamespace(world=SimpleNamespace(name="w"))
    commands = {"status": lambda *_: {}}
    world: Any = SimpleNamespace(algorithm=algorithm, system=REAL, commands=commands)
    admission = Admission(Keys("w"), limits, ListenConfig(), lambda *line: None)
    answers = Answers(world, admission, limits, lambda: None)

    def ask(key, data=STATUS, session=b""):
        def reply(answer):
            replies.append((session.decode() or key, unpack(answer)))

        query: Any = Query(f"minerva/w/{key}", data, reply, session)
        question = answers.admit(query)
        if question is not None:
            answers.add(question)
        return question is not None

    return ask, replies, answers


def test_those_of_readers_leave_room_for_those_of_operators(asked):
    ask, replies, answers = asked
    assert [ask("ask/eve") for _ in range(3)] == [True, True, False]
    assert "2 questions wait for an answer already" in replies.pop()[1]["error"]
    assert ask("control/ann")
    while any(answers.waiting):
        answers.answer_due()
    assert [key for key, _ in replies] == ["control/ann", "ask/eve", "ask/eve"]
    assert ask("ask/eve")


def test_those_of_a_session_leave_room_for_another_and_are_answered_in_turns(asked):
    ask, replies, answers = asked
    assert [ask("control") for _ in range(3)] == [True, True, False]
    assert ask("control", session=b"ann")
    replies.clear()
    while any(answers.waiting):
        answers.answer_due()
    assert [key for key, _ in replies] == ["control", "ann", "control"]
    # Certificates name the sender, whatever a question says of its session.
    assert [ask("control/eve", session=b"%d" % n) for n in range(3)] == [True, True, False]


def test_one_that_is_too_large_is_not_kept(asked):
    ask, replies, answers = asked
    assert not ask("control", b"x" * 300_000)
    assert not any(answers.waiting)
    assert replies == [("control", {"error": "a question has 300000 bytes, over 262144"})]


@pytest.mark.parametrize("key", ["**", "minerva/**", "minerva/w/**", "minerva/*", "minerva/w/*/x"])
def test_one_on_a_pattern_may_only_read(key):
    assert who_asks(key, "w") == ("", False, "minerva/w/control")
