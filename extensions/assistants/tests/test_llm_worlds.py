"""Worlds with an `llm`: nobody waits, faults stay where they are, runs repeat without a backend."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import sys
from pathlib import Path

import pytest
from chat_server import Answered, ChatServer, prompt_of
from tool_server import tool_server

from minerva_bus.log.record import Record
from tests.runtime.running import World, eventually, here, minerva, summary

KEY = "sk-a-very-secret-key"
STRING = "AMind#mind · APerson#anna · APerson#ben · APerson#cleo"
WORLD = """
[world]
name = "NAME"
string = "STRING"
vocabulary = "town:vocabulary"
seed = 3
frames = 60

[process.minds]
agents = "mind"

[process.folk]
agents = ["town:Person", "town:Mortal"]

[process.steps]
service = "each"
event = "eStep"

[process.llm]
service = "llm"
"""


def write_town(folder, backend, *more, string=STRING):
    """Write a world with an `llm`, and the module `town` beside it."""
    shutil.copy(Path(__file__).with_name("town.py"), folder / "town.py")
    name = f"town-{os.getpid()}-{len(list(folder.iterdir()))}"
    text = WORLD.replace("NAME", name).replace("STRING", string)
    path = folder / f"{name}.toml"
    path.write_text("\n".join([text, f"backend = {json.dumps(backend)}", *more]))
    return path


def town_of(folder, record):
    """The agents at the end of a record, each in one line."""
    done = here(folder, "info", record, "--string")
    assert done.returncode == 0, done.stderr
    return {line.split("#")[1].split("<")[0]: line for line in done.stdout.splitlines()}


def recomputes(folder, record):
    done = here(folder, "replay", record, "--recompute")
    return done.returncode == 0, done.stdout + done.stderr


def answer(asked):
    """A server with a fault for some agents."""
    prompt = prompt_of(asked)
    if "anna" in prompt:
        return Answered(hangs=True)
    if "ben" in prompt:
        return Answered(status=500, raw="broken")
    if "cleo" in prompt:
        return Answered("42, obviously")
    return Answered('{"action": "eat", "amount": 1}')


def test_faults_of_some_requests_do_not_reach_other_agents(tmp_path, monkeypatch):
    monkeypatch.setenv("TOWN_KEY", KEY)
    monkeypatch.setenv("NO_PROXY", "*")
    people = ["anna<within=4>", "ben", "cleo", "dan", "emil<wanted=5>"]
    string = "AMind#mind · " + " · ".join(f"APerson#{person}" for person in people)
    with ChatServer(answer) as server:
        options = ['key_env = "TOWN_KEY"', "retries = 1", "corrections = 1", 'cache = "cache"']
        path = write_town(tmp_path, server.url, *options, string=string)
        words = "--until", "eHappy", "--frames", "0", "--rate", "40", "--record", "a.mcap"
        done = minerva(tmp_path, "run", path, "--in-process", *words, "--json")
        result = summary(done)
        assert set(server.keys) == {f"Bearer {KEY}"}
    town = town_of(tmp_path, "a.mcap")
    fates = {
        name: line.split("fate=[")[1].split("]")[0] for name, line in town.items() if "fate" in line
    }
    assert fates == {
        "anna": '"time", "time"',
        "ben": '"backend", "backend"',
        "cleo": '"invalid", "invalid"',
        "dan": '"eat 1", "eat 1"',
        "emil": ", ".join(['"eat 1"'] * 5),
    }
    # Each agent has lived in each frame.
    assert all(f"steps={result['frames']}" in line for name, line in town.items() if name != "mind")
    # The server is gone.
    assert recomputes(tmp_path, "a.mcap")[0]
    frames = here(tmp_path, "replay", "a.mcap", "--no-code", "--json").stdout
    assert "I am anna at" in frames
    assert "tokens_in" in frames
    for text in (frames, done.stdout, done.stderr, "".join(map(str, town.values()))):
        assert KEY not in text


def test_a_run_with_a_script_has_one_digest_everywhere(tmp_path):
    path = write_town(tmp_path, "town:RULES", "agent_budget = { calls = 3 }")
    alone = summary(here(tmp_path, "run", path, "--in-process", "--record", "a.mcap", "--json"))
    with World(path, "--rate", "40", "--json") as world:
        names = ("minds", "folk", "steps", "llm")
        os.kill(world.runs(*names)["llm"], signal.SIGKILL)
        assert world.summary()["digest"] == alone["digest"]
    town = town_of(tmp_path, "a.mcap")
    assert 'fate=["eat 2", "budget"]' in town["ben"]
    # 0.8 s for two attempts: asked in frame 0, received in frame 1.
    assert recomputes(tmp_path, "a.mcap")[0]


def test_results_of_tools_are_recorded_and_not_needed_again(tmp_path, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "*")
    rules = [
        {
            "when": "I am",
            "answer": [
                {"tool": "yard.add", "arguments": {"a": 17, "b": 25}},
                {"action": "eat", "amount": 4},
            ],
        }
    ]
    (tmp_path / "rules.py").write_text(f"RULES = {rules}")
    with tool_server() as url:
        server = f'tools.yard = {{ url = "{url}", allow = ["add"], timeout = 60 }}'
        path = write_town(tmp_path, "rules:RULES", server, "wait = true")
        summary(here(tmp_path, "run", path, "--in-process", "--record", "t.mcap", "--json"))
    (tmp_path / "rules.py").unlink()
    with Record(tmp_path / "t.mcap") as record:
        events = [event for frame in record.frames() for event in frame.events]
    used = [event.data["tools"] for event in events if event.type == "eReply"]
    assert used
    assert all('"result": "42"' in tools for tools in used)
    same, output = recomputes(tmp_path, "t.mcap")
    assert same, output


@pytest.mark.parametrize("backend", ["rules.toml", "gone_rules:decide"])
def test_a_past_is_repeated_and_explained_after_its_backend_is_gone(tmp_path, backend):
    rules = '[[rules]]\nanswer = { action = "eat", amount = 3 }\n'
    (tmp_path / "rules.toml").write_text(rules)
    decide = "def decide(prompt):\n    return {'action': 'eat', 'amount': 3}\n"
    (tmp_path / "gone_rules.py").write_text(decide)
    path = write_town(tmp_path, backend, "wait = true")
    summary(here(tmp_path, "run", path, "--in-process", "--record", "g.mcap", "--json"))
    (tmp_path / "rules.toml").unlink()
    (tmp_path / "gone_rules.py").unlink()
    # This process has imported it; a new one could not.
    sys.modules.pop("gone_rules", None)
    shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
    same, output = recomputes(tmp_path, "g.mcap")
    assert same, output
    why = here(tmp_path, "explain", "g.mcap", "--agent", "anna", "--attribute", "fate")
    assert why.returncode == 0, why.stderr
    assert "eChoice" in why.stdout
    # What runs on needs it, and says so before its first frame.
    for words in (("check", path), ("run", path, "--in-process"), ("run", "--resume", "g.mcap")):
        done = here(tmp_path, *words)
        assert done.returncode, done.stdout
        assert backend.partition(":")[0] in done.stderr


def test_branches_have_the_answers_of_the_past_and_ask_on(tmp_path):
    path = write_town(tmp_path, "town:RULES")
    done = summary(here(tmp_path, "run", path, "--in-process", "--record", "b.mcap", "--json"))
    backends = "llm.backend=town:RULES,town:decide"
    words = "branch", "b.mcap", "--frame", "6", "--set", backends, "--in-process", "--workers", "1"
    assert minerva(tmp_path, *words).returncode == 0
    rows = list(csv.DictReader((tmp_path / "b-6.csv").open()))
    # Requests that were open in frame 6 are answered as in the record, unless by another backend.
    assert [row["digest"] == done["digest"] for row in rows] == [True, False]
    assert [row["llm.backend"] for row in rows] == ["town:RULES", "town:decide"]


def test_a_resumed_run_continues_requests_and_budgets(tmp_path):
    path = write_town(tmp_path, "town:RULES", "agent_budget = { calls = 3 }")
    alone = summary(here(tmp_path, "run", path, "--in-process", "--json"))
    for frames in (5, 12):
        done = here(tmp_path, "run", path, "--in-process", "--frames", frames, "--record", "r.mcap")
        assert done.returncode == 0
        words = "--resume", "r.mcap", "--in-process", "--frames", "60", "--json"
        again = summary(here(tmp_path, "run", path, *words))
        assert again["digest"] == alone["digest"]


def test_frames_can_wait_for_answers(tmp_path):
    path = write_town(tmp_path, "town:decide", "wait = true")
    digests = {
        summary(here(tmp_path, "run", path, "--in-process", "--record", "w.mcap", "--json"))[
            "digest"
        ]
        for _ in range(2)
    }
    assert len(digests) == 1
    assert 'fate=["sleep 3", "sleep 3"]' in town_of(tmp_path, "w.mcap")["ben"]


def test_a_recorded_run_can_be_repeated_with_another_model(tmp_path):
    path = write_town(tmp_path, "town:decide", "wait = true")
    summary(here(tmp_path, "run", path, "--in-process", "--record", "w.mcap", "--json"))
    swap = "swap", "w.mcap", "llm=llm", "--record", "s.mcap"
    done = here(tmp_path, *swap, "--backend", "town:RULES")
    assert done.returncode == 1, done.stderr
    assert 'fate=["eat 2", "eat 2"]' in town_of(tmp_path, "s.mcap")["ben"]
    done = here(tmp_path, *swap, "--backend", "town:decide")
    assert "runs freely" in done.stderr


def test_a_killed_service_continues_what_is_open(tmp_path, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "*")
    with ChatServer(lambda asked: Answered(hangs=True)) as hanging:
        port = hanging.port
        options = ['model = "m"', "timeout = 1000.0", "retries = 1000"]
        path = write_town(tmp_path, hanging.url, *options)
        words = "--until", "eHappy", "--frames", "0", "--rate", "40", "--record", "k.mcap", "--json"
        with World(path, *words) as world:
            pids = world.runs("minds", "folk", "steps", "llm")
            eventually(lambda: len(hanging.calls) == 3, "three calls")
            os.kill(pids["llm"], signal.SIGKILL)
            world.says("llm │ was killed by SIGKILL; restart 1 of 5 in")
            eventually(lambda: len(hanging.calls) == 6, "the same calls again")
            figures = eventually(lambda: world.members()["llm"]["figures"], "figures")
            assert figures["pending"] == 3
            hanging.__exit__()  # The server is killed, too, and returns.
            with ChatServer(lambda asked: Answered('{"action": "eat", "amount": 7}'), port):
                frames = world.summary()["frames"]
    town = town_of(tmp_path, "k.mcap")
    for person in ("anna", "ben", "cleo"):
        assert f"steps={frames}" in town[person]
        assert 'fate=["eat 7", "eat 7"]' in town[person]
    assert recomputes(tmp_path, "k.mcap")[0]


def test_the_death_of_an_agent_cancels_its_calls(tmp_path, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "*")
    with ChatServer(lambda asked: Answered(hangs=True)) as server:
        string = "AMind#mind · AMortal#max"
        path = write_town(tmp_path, server.url, 'model = "m"', string=string)
        words = "--frames", "0", "--rate", "40", "--record", "m.mcap", "--json"
        with World(path, *words) as world:
            world.runs("minds", "folk", "steps", "llm")

            def cancelled():
                figures = world.members()["llm"]["figures"]
                return (figures.get("cancelled"), figures.get("pending")) == (1, 0)

            eventually(cancelled, "a cancelled request")
            assert minerva(tmp_path, "stop", world.name).returncode == 0
            world.ends()
    assert "requests={}" in town_of(tmp_path, "m.mcap")["mind"]


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ('key_env = "NO_SUCH_KEY"', "environment variable NO_SUCH_KEY is not set"),
        ("timeout = -1.0", "timeout is -1.0"),
        ("tries = 3", "Llm has no option 'tries'"),
    ],
)
def test_a_wrong_option_is_reported(tmp_path, option, message):
    path = write_town(tmp_path, "http://127.0.0.1:9/v1", option)
    done = minerva(tmp_path, "run", path)
    assert message in done.stderr
    assert "Traceback" not in done.stderr
