"""Calls of backends: a real HTTP server with faults, functions, programs, scripts and limits."""

from __future__ import annotations

import json
import sys
import threading
from contextlib import contextmanager
from typing import Literal

import pytest
from chat_server import Answered, ChatServer, prompt_of

from minerva_assistants.llm import answering
from minerva_assistants.llm.answering import CallLimits, CallSetup
from minerva_assistants.llm.budgets import Budget, Ledger, Prices
from minerva_assistants.llm.cache import CompletionCache
from minerva_assistants.llm.call_runner import CallRunner
from minerva_assistants.llm.http import HttpBackend
from minerva_assistants.llm.local import CommandBackend, FunctionBackend
from minerva_assistants.llm.reading import MindRequest
from minerva_assistants.llm.script import ScriptBackend
from minerva_assistants.llm.service import Llm
from minerva_assistants.llm.tools import ToolServers
from minerva_assistants.minds import eAnswer
from minerva_assistants.minds.mind import OpenRequest
from minerva_bus import EventType
from minerva_bus.errors import MisuseError
from tests.patience import eventually, patience

eChoice = EventType("eChoice", action=Literal["eat", "sleep"])
EAT = Answered('{"action": "eat"}')


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(answering, "FIRST_WAIT_SECONDS", 0.01)
    monkeypatch.setenv("NO_PROXY", "*")


def request(number=1, agent="anna", prompt="what next?", answer="eChoice"):
    opened = OpenRequest(number, agent, prompt, "You are polite.", answer, "", 0, 100)
    return MindRequest("mind", opened)


class Calls:
    """A caller with its log."""

    def __init__(self, backend, limits, more):
        self.log = []
        given = {
            "events": {"eChoice": eChoice, "eAnswer": eAnswer},
            "system": "The year is 1300.",
            "prices": Prices({"small": [1.0, 10.0]}),
            "ledger": Ledger(Budget(), Budget()),
            "cache": CompletionCache(""),
            "tools": ToolServers([], 1, self.log.append),
        }
        setup = CallSetup(backend=backend, log=self.log.append, **(given | more))
        self.caller = CallRunner(setup, CallLimits(**limits))

    def __call__(self, *requests):
        """The results of these requests, in the order of their numbers."""
        for each in requests:
            self.caller.ask(each)
        results = [self.caller.results.get() for _ in requests]
        return sorted(results, key=lambda result: result.asked.key)


@contextmanager
def calling(backend, more=None, **limits):
    if isinstance(backend, ChatServer):
        backend = HttpBackend(backend.url, "small", lambda: "sk-secret", {"temperature": 0})
    calls = Calls(backend, limits, more or {})
    try:
        yield calls
    finally:
        calls.caller.close()


# --- HTTP -----------------------------------------------------------------------------------------


def test_a_call_has_prompt_schema_key_and_its_reply_usage():
    with ChatServer(lambda asked: EAT) as server, calling(server) as calls:
        (result,) = calls(request())
    assert (result.outcome, result.content) == ("answered", '{"action": "eat"}')
    usage = result.usage
    assert (usage.calls, usage.tokens_in, usage.tokens_out) == (1, 100, 20)
    assert usage.cost == pytest.approx((100 * 1 + 20 * 10) / 1e6)
    (asked,) = server.calls
    assert asked["model"] == "small"
    assert asked["temperature"] == 0
    assert asked["response_format"]["json_schema"]["schema"]["properties"] == {
        "action": {"type": "string", "enum": ["eat", "sleep"]}
    }
    system = asked["messages"][0]["content"]
    assert system.startswith("The year is 1300.\n\nYou are polite.\n\nAnswer with one JSON object")
    assert server.keys == ["Bearer sk-secret"]
    assert calls.log == []


def test_a_model_without_a_price_is_named():
    prices = {"prices": Prices({"smal": [1.0, 10.0]})}
    with ChatServer(lambda asked: EAT) as server, calling(server, prices) as calls:
        (result,) = calls(request())
    assert result.usage.cost == 0
    assert calls.log == [
        "llm: prices has no model 'small'; did you mean 'smal'?; its completions cost nothing"
    ]


@pytest.mark.parametrize("wait", ["3600", "9" * 400])
def test_a_server_that_wants_a_long_pause_is_not_called_again(wait):
    busy = Answered(status=429, raw="slow down", headers={"Retry-After": wait})
    with ChatServer(lambda asked: busy) as server, calling(server) as calls:
        (result,) = calls(request())
    assert result.outcome == "backend"
    assert "slow down; the server allows no call within" in result.content
    assert len(server.calls) == 1


def test_without_a_model_the_first_one_that_the_server_lists_is_used():
    with ChatServer(lambda asked: EAT) as server:
        backend = HttpBackend(server.url + "/", "", lambda: "", {})
        with calling(backend) as calls:
            calls(request())
    assert server.calls[0]["model"] == "small"
    assert set(server.keys) == {""}


def test_an_invalid_answer_is_corrected_with_the_reason():
    texts = iter(["I would rather dance", '{"action": "dance"}', '{"action": "sleep"}'])
    with ChatServer(lambda asked: Answered(next(texts))) as server, calling(server) as calls:
        (result,) = calls(request())
    assert result.content == '{"action": "sleep"}'
    assert result.usage.calls == 3
    *_, answer, correction = server.calls[2]["messages"]
    assert answer == {"role": "assistant", "content": '{"action": "dance"}'}
    assert "action must be one of eat, sleep, not 'dance'" in correction["content"]


def test_nonsense_has_an_end():
    server = ChatServer(lambda asked: Answered("nonsense"))
    with server, calling(server, corrections=1) as calls:
        (result,) = calls(request())
    assert result.outcome == "invalid"
    assert result.content == "expected a JSON object, not 'nonsense'"
    assert len(server.calls) == 2


@pytest.mark.parametrize(
    "fault",
    [
        Answered(status=500, raw="oops"),
        Answered(status=429, raw="slow down", headers={"Retry-After": "0"}),
        Answered(raw="<html>"),
        Answered(raw="{}"),
        Answered(raw='{"choices": [{"message": {"content": null}}]}'),
    ],
)
def test_a_fault_that_passes_is_retried(fault):
    replies = iter([fault, EAT])
    with ChatServer(lambda asked: next(replies)) as server, calling(server) as calls:
        (result,) = calls(request())
    assert result.outcome == "answered"
    assert result.usage.calls == 2


def test_a_fault_that_remains_is_not_retried_and_no_message_has_the_key():
    echo = Answered(status=401, raw="wrong key: sk-secret")
    with ChatServer(lambda asked: echo) as server, calling(server) as calls:
        (result,) = calls(request())
    assert result.outcome == "backend"
    assert result.content == "status 401: wrong key: (key)"
    assert len(server.calls) == 1
    assert calls.log == ["llm: status 401: wrong key: (key)"]


def test_a_redirection_is_not_followed_and_says_where_to():
    goes = Answered(status=307, headers={"Location": "http://elsewhere:1/v1/chat"})
    with ChatServer(lambda asked: goes) as server, calling(server) as calls:
        (result,) = calls(request())
        assert len(server.calls) == 1
    assert result.outcome == "backend"
    assert result.content == (
        "status 307: the server redirects to http://elsewhere:1/v1/chat; set backend to it"
    )


def test_an_address_that_cannot_exist_and_unexpected_errors_are_logged():
    backend = HttpBackend("http://256.1.1.1/v1", "small", str, {})
    with calling(backend) as calls:
        (result,) = calls(request())
    assert "256.1.1.1" in result.content
    assert calls.log == [f"llm: {result.content}"]
    broken = FunctionBackend("it", lambda prompt: "x")
    broken.complete = lambda prompt: 1 / 0
    with calling(broken) as calls:
        (result,) = calls(request())
    assert calls.log == ["llm: ZeroDivisionError: division by zero"]


def test_a_server_that_hangs_delays_only_its_own_request():
    def answer(asked):
        return Answered(hangs=True) if "anna" in prompt_of(asked) else EAT

    with ChatServer(answer) as server, calling(server, timeout=0.3, retries=1) as calls:
        hanging, fine = calls(request(1, prompt="I am anna"), request(2, prompt="I am ben"))
    assert hanging.content == "no answer within 0.3 s"
    assert (hanging.outcome, fine.outcome) == ("backend", "answered")


def test_a_server_may_be_killed_and_return():
    with ChatServer(lambda asked: EAT) as server:
        port = server.port
        backend = HttpBackend(server.url, "small", lambda: "", {})
        with calling(backend, retries=1000) as calls:
            assert calls(request())[0].outcome == "answered"
            server.__exit__()
            calls.caller.ask(request(2))
            eventually(lambda: calls.log)
            assert calls.caller.results.empty()
            with ChatServer(lambda asked: EAT, port):
                result = calls.caller.results.get()
    assert result.outcome == "answered"


def test_a_cancelled_request_ends_at_once():
    with ChatServer(lambda asked: Answered(hangs=True)) as server, calling(server) as calls:
        calls.caller.ask(request())
        eventually(lambda: server.calls)
        calls.caller.cancel(("mind", 1))
        result = calls.caller.results.get()
        assert (result.outcome, result.usage.calls) == ("cancelled", 1)
        # Also one that has not begun.
        calls.caller._loop.call_soon_threadsafe(
            lambda: (calls.caller._start(request(2)), calls.caller._stop(("mind", 2)))
        )
        result = calls.caller.results.get()
        assert (result.outcome, result.usage.calls) == ("cancelled", 0)


def test_calls_are_concurrent_up_to_a_limit():
    barrier = threading.Barrier(3, timeout=patience(20))

    def answer(asked):
        barrier.wait()
        return EAT

    with ChatServer(answer) as server, calling(server, concurrent=3) as calls:
        results = calls(*(request(number) for number in range(9)))
    assert {result.outcome for result in results} == {"answered"}
    assert server.most <= 3


# --- budgets and the cache ------------------------------------------------------------------------


def test_a_budget_ends_calls():
    ledger = Ledger(Budget(calls=4), Budget(tokens=150))
    server = ChatServer(lambda asked: EAT)
    with server, calling(server, {"ledger": ledger}, concurrent=1) as calls:
        agents = ["anna", "anna", "anna", "ben", "cleo", "dan"]
        results = calls(*(request(n, agent) for n, agent in enumerate(agents)))
    assert [result.outcome for result in results] == ["answered"] * 2 + ["budget"] + [
        "answered",
        "answered",
        "budget",
    ]
    assert results[2].content == "#anna has used 240 of 150 tokens"
    assert results[5].content == "the world has used 4 of 4 calls"


def test_an_equal_prompt_is_completed_once(tmp_path):
    cache = CompletionCache(str(tmp_path / "cache"))
    with ChatServer(lambda asked: EAT) as server, calling(server, {"cache": cache}) as calls:
        first = calls(request(1))[0]
        second = calls(request(2, "ben"))[0]
        other = calls(request(3, prompt="and then?"))[0]
        for file in (tmp_path / "cache").iterdir():
            assert "sk-secret" not in file.read_text()
            file.write_text("{damaged")
        again = calls(request(4))[0]
    assert [first.cached, second.cached, other.cached, again.cached] == [False, True, False, False]
    assert (second.content, second.usage.calls) == (first.content, 0)
    assert len(server.calls) == 3


# --- functions, programs and scripts --------------------------------------------------------------


def test_a_function_answers():
    def decide(prompt):
        return {"action": "eat" if prompt.request.asker == "anna" else "sleep"}

    async def decide_later(prompt):
        return '{"action": "sleep"}'

    def fail(prompt):
        raise ValueError("too difficult")

    with calling(FunctionBackend("town:decide", decide)) as calls:
        assert calls(request())[0].content == '{"action": "eat"}'
    with calling(FunctionBackend("town:decide_later", decide_later)) as calls:
        assert calls(request())[0].content == '{"action": "sleep"}'
    with calling(FunctionBackend("town:fail", fail)) as calls:
        result = calls(request())[0]
    assert (result.outcome, result.content) == ("backend", "town:fail: ValueError: too difficult")


def test_a_program_answers():
    code = "import json, sys; print(json.load(sys.stdin)['asker'])"
    with calling(CommandBackend([sys.executable, "-c", code])) as calls:
        assert calls(request(answer="eAnswer"))[0].content == '{"text": "anna", "topic": ""}'
    with calling(CommandBackend([sys.executable, "-c", "exit('no idea')"]), retries=0) as calls:
        result = calls(request())[0]
    assert result.outcome == "backend"
    assert result.content.endswith("exited with 1: no idea")
    with calling(CommandBackend(["/nowhere/model"])) as calls:
        assert calls(request())[0].content == "/nowhere/model: No such file or directory"


def test_a_program_that_prints_without_end_is_killed():
    code = "import os\nwhile True: os.write(1, bytes(65536))"
    with calling(CommandBackend([sys.executable, "-c", code]), retries=0) as calls:
        result = calls(request())[0]
    assert (result.outcome, result.content) == ("backend", "more than 4 MiB")


def test_a_program_need_not_read_its_input():
    with calling(CommandBackend([sys.executable, "-c", "print('yes')"])) as calls:
        result = calls(request(prompt="x" * 1_000_000, answer="eAnswer"))[0]
    assert result.outcome == "answered"


def test_a_script_answers_by_rules():
    rules = [
        {"when": "(?P<n>[0-9]+) apples", "answer": {"text": "eat {n} of {them}"}, "seconds": 2},
        {"when": "next", "answer": ["dance", {"action": "sleep"}], "tokens": [7, 3]},
    ]
    with calling(ScriptBackend("town:RULES", rules)) as calls:
        first, second, third = calls(
            request(1, prompt="I have 12 apples", answer="eAnswer"),
            request(2, prompt="what next?"),
            request(3, prompt="?"),
        )
    assert first.content == '{"text": "eat 12 of {them}", "topic": ""}'
    assert (first.simulated, second.content, second.usage.calls) == (2.0, '{"action": "sleep"}', 2)
    assert second.usage.tokens_in == 14
    assert (third.outcome, third.content) == ("backend", "town:RULES: no rule for '?'")


def _pieces(*texts, end="data: [DONE]\n\n"):
    events = [{"choices": [{"delta": {"content": text}}]} for text in texts]
    events.append({"choices": [], "usage": {"prompt_tokens": 7, "completion_tokens": 2}})
    return "".join([f"data: {json.dumps(event)}\n\n" for event in events]) + end


def test_an_answer_is_streamed_and_cut_off_or_late_ones_are_repeated():
    whole = _pieces('{"action": ', '"eat"}')
    replies = [Answered(raw=_pieces("{", end="")), Answered(hangs=True), Answered(raw=whole), EAT]
    with ChatServer(lambda asked: replies.pop(0)) as server:
        backend = HttpBackend(server.url, "small", str, {}, stream=True, first_token=2.0)
        with calling(backend) as calls:
            (first,) = calls(request(1))
            (plain,) = calls(request(2))
    assert (first.outcome, first.content) == ("answered", '{"action": "eat"}')
    assert (first.usage.calls, first.usage.tokens_in, first.usage.tokens_out) == (3, 7, 2)
    assert plain.content == '{"action": "eat"}', "of a server that does not stream"
    assert calls.log == ["llm: the stream has been cut off", "llm: no first piece within 2 s"]
    assert server.calls[0]["stream"] is True


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"backend": ""}, "backend must be a base URL"),
        ({"backend": 7}, "backend must be a base URL"),
        ({"backend": []}, "backend is an empty list"),
        ({"backend": "http://me:secret@host/v1"}, "without user or query"),
        ({"backend": "http://host/v1?key=secret"}, "without user or query"),
        ({"backend": "http://[::1/v1"}, "backend must be a base URL"),
        ({"backend": "http://host:99999/v1"}, "backend must be a base URL"),
        ({"backend": "HTTP://host:port/v1"}, "backend must be a base URL"),
        ({"backend": "missing.toml"}, "script missing.toml: No such file"),
        ({"backend": ["x"], "concurrent": 0}, "concurrent is 0; expected at least 1"),
        ({"backend": ["x"], "timeout": 0.0}, "timeout is 0.0; expected seconds above 0"),
        ({"backend": ["x"], "budget": {"call": 1}}, "budget has no 'call'; did you mean 'calls'?"),
        ({"backend": ["x"], "agent_budget": {"cost": -1}}, "agent_budget.cost is -1"),
        ({"backend": ["x"], "agent_budget": {"cost": 1}}, "a budget of cost needs prices"),
        ({"backend": ["x"], "prices": {"m": 3}}, "prices.m must be the prices of a million"),
        ({"backend": ["x"], "key_env": "A", "key_file": "b"}, "not both"),
        ({"backend": "http://host/v1", "first_token": 3}, "expected seconds, with stream"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(MisuseError) as raised:
        Llm(**options)
    assert message in str(raised.value)
    assert "secret" not in str(raised.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rules = 3", "expected a list of rules"),
        ("[[rules]]\nwhen = 'a'", "a rule needs an answer"),
        ("[[rules]]\nwhen = '('\nanswer = 'a'", "a rule is wrong"),
        ("[[rules]]\nanswers = 'a'", "a rule has no 'answers'; did you mean 'answer'?"),
        ("[[rules]]\nanswer = 'a'\nseconds = -1", "seconds is -1"),
        ("rules = [1]", "rules"),
        ("[[rules]", "script"),
    ],
)
def test_a_wrong_script_is_refused(tmp_path, text, message):
    path = tmp_path / "script.toml"
    path.write_text(text)
    with pytest.raises(MisuseError) as raised:
        Llm(str(path))
    assert message in str(raised.value)
