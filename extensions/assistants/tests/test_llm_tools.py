"""Tools of MCP servers that models call before they answer: a real server, and faulty ones."""

from __future__ import annotations

import sys
from typing import Literal

import pytest
from tool_server import tool_server

from minerva_assistants.llm.answering import CallLimits, CallSetup
from minerva_assistants.llm.budgets import Budget, Ledger, Prices
from minerva_assistants.llm.cache import CompletionCache
from minerva_assistants.llm.call_runner import CallRunner
from minerva_assistants.llm.reading import MindRequest
from minerva_assistants.llm.script import ScriptBackend
from minerva_assistants.llm.service import Llm
from minerva_assistants.llm.tools import MAX_RESULT, ToolServers
from minerva_assistants.minds.mind import OpenRequest
from minerva_bus import EventType
from minerva_bus.errors import MisuseError

eChoice = EventType("eChoice", action=Literal["eat", "sleep"])


@pytest.fixture(scope="module")
def url():
    with tool_server() as address:
        yield address


def results(servers, answers, *, prompts=("what next?",), log=None, **limits):
    """The results of requests, of a script whose answers follow each other."""
    setup = CallSetup(
        ScriptBackend("s", [{"when": "what", "answer": answers}, {"answer": {"action": "eat"}}]),
        {"eChoice": eChoice}, "", Prices({}), Ledger(Budget(), Budget()), CompletionCache(""),
        (lambda line: None) if log is None else log.append,
        ToolServers.of(servers, 4, (lambda line: None) if log is None else log.append),
    )  # fmt: skip
    runner = CallRunner(setup, CallLimits(**limits))
    try:
        for number, prompt in enumerate(prompts):
            asked = OpenRequest(number, f"p{number}", prompt, "", "eChoice", "", 0, 100)
            runner.ask(MindRequest("mind", asked))
        ended = [runner.results.get() for _ in prompts]
    finally:
        runner.close()
    return sorted(ended, key=lambda result: result.asked.request.number)


def use(tool, **arguments):
    return {"tool": tool, "arguments": arguments}


def test_a_model_calls_tools_and_faulty_servers_disturb_nobody(url, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "*")
    servers = {
        "yard": {"url": url, "allow": ["add", "lie", "fail"], "timeout": 30},
        "dead": {"command": [sys.executable, "-c", "raise SystemExit"], "allow": ["x"]},
        "mute": {"command": ["sleep", "60"], "allow": ["x"], "timeout": 0.2},
    }
    calls = [use("yard.add", a=2, b=3), use("yard.lie"), use("yard.fail"), use("yard.add", a="far")]
    calls += [
        use("dead.x"),
        use("mute.x"),
        use("yard.secret"),
        {"tool": "yard.add", "arguments": 7},
    ]
    log = []
    first, other = results(
        servers, [*calls, {"action": "sleep"}], prompts=("what next?", "hungry"), log=log,
        tool_calls=9,
    )  # fmt: skip
    assert (first.outcome, first.content) == ("answered", '{"action": "sleep"}')
    assert (other.outcome, other.tools) == ("answered", ())
    assert first.usage.calls == 9, "each completion counts in the budget"
    added, lied, failed, wrong, dead, mute, secret, no_object = first.tools
    assert (added.result, added.failed, added.arguments) == ("5", False, {"a": 2, "b": 3})
    assert len(lied.result) == MAX_RESULT
    assert failed.failed
    assert wrong.failed
    assert dead.failed
    assert (mute.failed, mute.result) == (True, "no result within 0.2 s")
    assert (secret.failed, secret.result) == (True, "there is no such tool")
    assert no_object.failed
    assert any(line.startswith("llm: tools.dead: ") for line in log)


def test_a_request_calls_a_limited_number_of_tools(url, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "*")
    servers = {"yard": {"url": url, "allow": ["add"]}}
    (result,) = results(servers, use("yard.add", a=1, b=1), tool_calls=2, corrections=0)
    assert result.outcome == "invalid"
    assert len(result.tools) == 2


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (7, "tools.x is 7; expected a table"),
        ({}, "needs either a command or a url"),
        ({"url": "ftp://x", "allow": ["a"]}, "expected http://"),
        ({"command": ["x"]}, "tools.x.allow is empty"),
        ({"command": "x", "allow": ["a"]}, "expected a list of texts"),
        ({"command": ["x"], "allow": ["a"], "timeout": 0}, "expected seconds above 0"),
        ({"command": ["x"], "alow": ["a"]}, "has no 'alow'; did you mean 'allow'?"),
    ],
)
def test_wrong_servers_are_refused(table, message):
    with pytest.raises(MisuseError) as raised:
        Llm(["x"], tools={"x": table})
    assert message in str(raised.value)
