"""`--json`: each command that answers has it, and prints one JSON value on standard output."""

import json
import signal
from urllib.request import urlopen

import pytest
from typer.main import get_command

from minerva_bus.cli.main import app
from tests.runtime.running import Run, World, eventually, here, write_world

MEMBERS = """
[process.steps]
service = "yard:Steps"

[process.walkers]
agents = "yard:Walker"

[process.others]
agents = "yard:Walker"

[process.screen]
service = "yard:Screen"
on_failure = "ignore"
"""
BROKEN = """
from minerva_bus import *

class Broken(Device, draws=("eShow",)):
    def show(self, view):
        raise RuntimeError("no picture")
"""
WITHOUT = {
    "schema": "prints a JSON Schema, which is JSON already",
    "keys router": "prints a configuration of zenohd, which is JSON already",
}


def commands(command, *words):
    if hasattr(command, "commands"):
        for name in command.commands:
            yield from commands(command.commands[name], *words, name)
    else:
        yield " ".join(words), command


def test_every_command_has_it():
    lacking = {
        name
        for name, command in commands(get_command(app))
        if "--json" not in [option for parameter in command.params for option in parameter.opts]
    }
    assert lacking == WITHOUT.keys()


# --- a running world ---


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    path = write_world(tmp_path_factory.mktemp("answering"), MEMBERS, frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers", "others", "screen")
        yield world


def answer(folder, *words, code=0):
    """The JSON object that a command prints, alone on standard output."""
    done = here(folder, *words, "--json")
    assert done.returncode == code, done.stderr
    assert done.stdout.count("\n") == 1
    return json.loads(done.stdout)


def test_pace(world):
    paused = answer(world.folder, "pause")
    assert paused == {"world": world.name, "frame": paused["frame"]}
    stepped = answer(world.folder, "step", 3)
    assert stepped == {"world": world.name, "frame": paused["frame"] + 3}
    assert answer(world.folder, "list")["frame"] == stepped["frame"]
    assert answer(world.folder, "rate", 20) == {"world": world.name, "hz": 20.0}
    assert answer(world.folder, "resume") == {"world": world.name}
    with world.client() as client:
        assert client.operator.status().rate == 20.0
        assert not client.operator.status().paused


def test_members(world):
    drained = answer(world.folder, "drain", "others")
    assert drained == {"world": world.name, "member": "others", "hosts": ["walkers"]}
    restarted = answer(world.folder, "restart", "screen")
    assert restarted == {"world": world.name, "member": "screen"}


def test_events(world):
    sent = answer(world.folder, "pub", "eWish", "x=1", "name=n")
    assert sent["event"].startswith("eWish")
    assert "note" not in sent
    ignored = answer(world.folder, "pub", "eNoise")
    assert ignored["note"] == "no agent kind of this world responds to eNoise"


def test_metrics_name_their_address(world):
    with Run(world.folder, "metrics", "--listen", "127.0.0.1:0", "--json") as served:
        line = eventually(lambda: served.output, "an address")[0]
        answer = json.loads(line)
        assert answer["world"] == world.name
        assert urlopen(answer["url"]).status == 200
        served.kill(signal.SIGINT)
        assert served.ends() == 0
    assert served.output == [line]


def test_an_attached_member_answers_when_it_leaves(world):
    """The view prints while it is attached; the answer is alone on standard output."""
    words = ("attach", "yard:Screen", "--name", "guest", "--said", "true", "--json")
    with Run(world.folder, *words) as guest:
        guest.says("frame ")
        guest.kill(signal.SIGINT)
        assert guest.ends() == 0
    [line] = guest.output
    left = {"member": "guest", "world": world.name, "endpoint": world.endpoint()}
    assert json.loads(line) == {**left, "ended": "", "failure": ""}


def test_an_attached_member_names_its_failure(world):
    (world.folder / "broken.py").write_text(BROKEN)
    with Run(world.folder, "attach", "broken:Broken", "--name", "ill", "--json") as guest:
        assert guest.ends() == 1
    [line] = guest.output
    failure = json.loads(line)["failure"]
    assert "RuntimeError: no picture" in failure
    assert failure in guest.text


def test_stop_and_seek(tmp_path):
    path = write_world(tmp_path, frames=20)
    with World(path, "--record", "a.mcap", "--frames", "20") as world:
        assert world.ends() == 0, world.text
    with Run(tmp_path, "replay", "a.mcap", "--speed", "0.01", "--json") as replay:
        eventually(lambda: here(tmp_path, "list", "--json").stdout[:1] == "{", "it runs")
        name = f"{path.stem}-replay"
        assert answer(tmp_path, "seek", 5) == {"world": name, "frame": 5}
        assert answer(tmp_path, "stop") == {"world": name}
        assert replay.ends() == 0
    assert json.loads("\n".join(replay.output))["world"] == name


# --- files ---


def test_keys(tmp_path):
    made = answer(tmp_path, "keys", "init")
    assert (made["folder"], made["coordinator"]["name"]) == ("keys", "coordinator")
    issued = answer(tmp_path, "keys", "issue", "ann", "--role", "view")
    assert (issued["name"], issued["roles"], issued["state"]) == ("ann", ["view"], "valid")
    assert answer(tmp_path, "keys", "revoke", "ann")["state"] == "revoked"
    listed = answer(tmp_path, "keys", "list")
    assert [each["name"] for each in listed] == ["ann", "coordinator"]
    assert answer(tmp_path, "keys", "revoke", "bob", code=2)["error"].startswith("keys")


@pytest.mark.parametrize("model", [(), ("--from", "meadow")])
def test_new(tmp_path, model):
    made = answer(tmp_path, "new", "world", "yonder", *model)
    assert (tmp_path / made["folder"]).is_dir()
    assert made["run"].startswith("minerva run ")
    assert bool(made["test"]) == bool(made["edit"]) == (not model)


def test_plot(tmp_path):
    pytest.importorskip("matplotlib")
    (tmp_path / "a.csv").write_text("frame,n\n0,1\n1,2\n")
    assert answer(tmp_path, "plot", "a.csv", "-o", "a.svg") == {"picture": "a.svg"}


# --- errors ---


@pytest.mark.parametrize(("words", "message"), [
    (["pause", "nowhere"], "nowhere"), (["drain"], "Missing argument"), (["rate", "x"], "expected a number"),
    (["logs", "--world", "nowhere"], "nowhere"), (["echo", "--world", "nowhere"], "nowhere"),
    (["list", "nowhere"], "nowhere"), (["top", "nowhere"], "nowhere"), (["stop", "nowhere"], "nowhere"),
    (["info", "no.mcap"], "no.mcap"), (["diff", "no.mcap", "no.mcap"], "no.mcap"),
    (["replay", "no.mcap", "--no-code"], "no.mcap"), (["recover", "no.mcap"], "no.mcap"),
    (["export", "no.mcap"], "--json needs --csv"), (["plot", "no.csv"], "no.csv"),
    (["map", "no.log"], "no.log"), (["new", "wordl", "a"], "'wordl'"), (["graph", "meadw"], "'meadow'"),
    (["sweep", "meadw", "--set", "seed=1"], "'meadow'"), (["keys", "issue", "a", "--role", "view"], "minerva keys init"),
    (["attach", "swg"], "swg"), (["bridge", "carmn"], "carmn"), (["conversation", "no.mcap"], "no.mcap"),
    (["determinism", "a.mnv"], "a string alone is none"), (["worlds", "x"], "x"),
])  # fmt: skip
def test_an_error_is_an_object_and_a_message(tmp_path, words, message):
    done = here(tmp_path, *words, "--json")
    assert done.returncode == 2
    [line] = done.stdout.splitlines()
    error = json.loads(line)["error"]
    assert message in error
    assert error.partition("\n")[0] in " ".join(done.stderr.split())


def test_the_place_in_a_wrong_string_is_in_the_object(tmp_path):
    path = write_world(tmp_path, string="AWalkr#a")
    reply = answer(tmp_path, "graph", path, code=2)
    assert (reply["line"], reply["column"]) == (1, 1)
    assert "AWalkr" in reply["error"]


def test_a_check_that_fails_is_the_answer_not_an_error(tmp_path):
    (tmp_path / "a.mnv").write_text("A · ")
    reply = answer(tmp_path, "check", "a.mnv", code=1)
    assert reply["ok"] is False
    assert reply["file"] == "a.mnv"
