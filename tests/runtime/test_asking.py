"""`minerva list`, `echo`, `pub` and `stop` on a running world, for people and as JSON."""

import json
import os
import signal

import pytest
from running import MEMBERS, Run, World, eventually, here, minerva, write_world

from minerva_bus.runtime.operator_client import AskingOperator
from tests.patience import patience

WISHES = '\n[process.wishes]\nservice = "yard:Wishes"\n'


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("asked")
    with World(write_world(folder, MEMBERS + WISHES, frames=0, rate=20)) as world:
        world.runs("steps", "walkers", "wishes")
        yield world


def ask(world, *words, code=0):
    done = here(world.folder, *words)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    return done


def lines(done):
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_a_window_without_a_person_gives_orders_in_the_name_of_its_process():
    asked = []
    window = AskingOperator(lambda question, **keys: asked.append(keys["by"]) or {}, "sprites")
    for person in ("", "anna"):
        window.named(person).resume()
    assert asked == ["sprites", "anna"]


def test_list(world):
    done = ask(world, "list")
    first, titles, *rows = done.stdout.splitlines()
    assert first.startswith(f"{world.name}: frame ")
    assert "agents" in first
    assert titles.split()[:3] == ["member", "state", "roles"]
    assert [row.split()[:3] for row in rows] == [
        ["steps", "present", "generator"],
        ["walkers", "present", "agents"],
        ["wishes", "present", "generator"],
    ]


def test_list_as_json(world):
    (row,) = lines(ask(world, "list", "--json", "--world", world.name))
    assert row["world"] == world.name
    assert row["agents"] >= 4
    assert [member["member"] for member in row["members"]] == ["steps", "walkers", "wishes"]
    assert row["members"][1]["kinds"] == ["AWalker"]
    assert row["members"][1]["pid"] == world.members()["walkers"]["pid"]
    (again,) = lines(ask(world, "list", "--json", "--connect", world.endpoint()))
    assert again["world"] == world.name


def test_echo_events(world):
    done = ask(world, "echo", "eStep", "--count", "3", "--json")
    rows = lines(done)
    assert [event["type"] for event in rows] == ["eStep"] * 3
    frames = [event["frame"] for event in rows]
    assert frames == list(range(frames[0], frames[0] + 3))
    assert all(isinstance(row["data"]["count"], int) for row in rows)
    shown = ask(world, "echo", "eStep", "--count", "2").stdout.splitlines()
    assert len(shown) == 2
    assert "eStep<count=" in shown[0]


def test_echo_all(world):
    assert len(ask(world, "echo", "--count", "5").stdout.splitlines()) == 5


def test_echo_fragments(world):
    rows = lines(ask(world, "echo", "AWalker", "--count", "4", "--json"))
    assert all(row["text"].startswith("AWalker#") for row in rows)


def test_echo_a_view(world):
    rows = lines(ask(world, "echo", "eShow", "--count", "2", "--json"))
    assert len(rows) == 2
    assert all(row["text"].startswith("TAt<x=") and "AWalker" not in row["text"] for row in rows)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("type_", ["eStep", "eShow"])
def test_echo_ends_by_a_signal_without_a_traceback(world, number, type_):
    with Run(world.folder, "echo", type_) as echo:
        eventually(lambda: len(echo.output) > 1, "it echoes")
        echo.kill(number)
        echo.ends()
        assert "Traceback" not in echo.text


def test_echo_ends_with_a_world_that_is_killed(tmp_path):
    with World(write_world(tmp_path, MEMBERS, frames=0, rate=20)) as world:
        world.runs("steps", "walkers")
        with Run(tmp_path, "echo", "--world", world.name) as echo:
            eventually(lambda: echo.output, "it echoes")
            os.killpg(world.process.pid, signal.SIGKILL)
            assert echo.ends() == 2
            assert echo.lines[-1].startswith(f"minerva: no world '{world.name}' answers at ")


def test_echo_into_a_pipe_that_is_closed(world):
    import subprocess

    from running import MINERVA, environment

    done = subprocess.run(
        ["sh", "-c", f"{' '.join(MINERVA)} echo eStep | head -n 1"], cwd=world.folder,
        env=environment(world.folder), capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout.count("\n") == 1
    assert "Traceback" not in done.stderr
    assert "BrokenPipe" not in done.stderr


def test_pub_reaches_the_agents_through_the_generator_that_takes_it(world):
    (sent,) = lines(ask(world, "pub", "eWish", "x=1 km", "name=north", "--to", "a", "--json"))
    assert sent["through"] == ["wishes"]
    assert sent["event"] == 'eWish<x=1000, name="north"> to #a'

    def scene():
        with world.client() as asked:
            return asked.ask("scene")["scene"]

    eventually(lambda: 'wish="north"' in scene(), "the wish arrives")
    assert scene().count('wish="north"') == 1
    words = "--if", "x < 100000", "--as", "anna"
    done = ask(world, "pub", "eWish", "x=2", 'name="so uth"', *words)
    assert 'eWish<x=2, name="so uth"> if x < 100000 sent by anna through wishes' in done.stdout
    eventually(lambda: 'wish="so uth"' in scene(), "all receive the wish")
    fates = [line["message"] for line in lines(ask(world, "logs", "orders", "--json"))]
    assert "to #a of people counts in frame" in fates[0]
    assert "if x < 100000 of anna counts in frame" in fates[1]


def test_pub_waits_for_the_fate_of_an_order(world):
    (sent,) = lines(ask(world, "pub", "eWish", "x=1", "name=n", "--as", "bert", "--wait", "--json"))
    order = sent["order"]
    assert (order["state"], order["person"], order["open"]) == ("accepted", "bert", False)
    assert order["frame"] >= sent["frame"]
    wrong = ask(world, "pub", "eWish", "x=1", "name=n", "--timeout", "1", code=2)
    assert "--timeout limits --wait" in wrong.stderr
    ask(world, "pause")
    words = ("x=1", "name=n", "--to", "a,b", "--wait", "--timeout", "0.1")
    late = ask(world, "pub", "eWish", *words, code=1)
    assert "is still open after 0.1 s: " in late.stderr
    ask(world, "resume")


@pytest.mark.parametrize(("words", "problem"), [
    (["eNothing"], "the world has no event type eNothing"),
    (["eWihs", "x=1", "name=n"], "eWish"),
    (["eWish"], "needs a value for x"),
    (["eWish", "x=1"], "needs a value for name"),
    (["eWish", "x=far", "name=n"], "x must be a number in m"),
    (["eWish", "x=1", "name=n", "y=3"], "has no y"),
    (["eWish", "x=1 s", "name=n"], "x must be a number in m"),
    (["eWish", "x", "name=n"], "'x': expected data as KEY=VALUE"),
    (["eWish", "x=1", "name=n", "--to", "nobody"], "there is no agent #nobody"),
    (["eWish", "x=1", "name=n", "--if", "x >"], "the condition cannot be read"),
    (["eStep", "count=1.5"], "count must be a whole number"),
    (["eStep", "count=99999999999999999999"], "count"),
    (["eNoise", "receivers=a"], "receivers"),
    (["eNoise", "condition=x"], "condition"),
    (["eNoise", "sender=x"], "sender"),
    (["eNoise", "self=x"], "self"),
    (["AWalker"], "the world has no event type AWalker"),
    (["eStep", "count=1, other=2"], "count"),
    (["eStep", "count=1> · PDot<x=3"], "count"),
    (["eStep", "count="], "count"),
    (["eStep", "count=3"], 'eStep comes from steps, so people may not send it'),
    (["eStep", "count=3"], 'write people = ["eStep"] under [world]'),
])  # fmt: skip
def test_a_wrong_event_is_named_and_the_world_goes_on(world, words, problem):
    done = ask(world, "pub", *words, code=2)
    assert problem in done.stderr
    before = world.members() and world.frame
    assert before
    eventually(lambda: world.members() and world.frame > before, "the world goes on")


def test_questions_that_make_no_sense_are_answered_with_an_error(world):
    import msgpack
    from yard import eNoise, eStep

    from minerva_bus.wire.strings_codec import plain_event

    with world.client() as asked:
        for payload in (
            b"", b"\xc1", msgpack.packb([]), msgpack.packb({}), msgpack.packb({"ask": 3}),
            msgpack.packb({"ask": "nonsense"}), msgpack.packb({"ask": "pub"}),
            msgpack.packb({"ask": "pub", "type": "eNoise", "data": []}),
            msgpack.packb({"ask": "pub", "type": "eNoise", "receivers": [3]}),
            msgpack.packb({"ask": "pub", "type": "eNoise", "condition": 5}),
            msgpack.packb({"ask": "pub", "type": "eStep", "data": {"count": 3}}),
            msgpack.packb({"ask": "pub", "type": "eWish", "data": {"x": "[" * 100_000, "name": "n"}}),
            msgpack.packb({"ask": "pub", "type": "eWish", "data": {"x": "1", "name": "n" * 20_000}}),
            msgpack.packb({"ask": "pub", "type": "eNoise", "more": [0] * 60_000}),
            msgpack.packb({"ask": "order", "event": plain_event(eStep(3))}),
            msgpack.packb({"ask": "order", "event": plain_event(eNoise(sender="a"))}),
            b"\x91" * 5000, b"\0" * (1 << 20),
        ):  # fmt: skip
            replies = list(
                asked._session.get(asked._control, payload=payload, timeout=patience(10))
            )
            assert [msgpack.unpackb(reply.ok.payload.to_bytes()).keys() for reply in replies] == [
                {"error"}
            ], payload[:50]
    assert world.members()


@pytest.mark.parametrize("words", [
    ("list", "--world", "nowhere"), ("echo", "--world", "nowhere"), ("stop", "nowhere"),
    ("pub", "eNoise", "--world", "nowhere"), ("echo", "eNothing"), ("list", "--connect", "nonsense"),
])  # fmt: skip
def test_a_world_or_type_that_is_not_there_is_named(world, words):
    done = ask(world, *words, code=2)
    assert done.stderr.startswith("minerva: ")
    assert done.stderr.count("\n") <= 3


def test_without_a_world_list_is_empty(tmp_path):
    assert here(tmp_path, "list", "--json").stdout == "[]\n"
    done = here(tmp_path, "list")
    assert done.returncode == 0
    assert done.stderr.startswith(
        "no world runs on this machine; elsewhere: minerva list --connect"
    )


def test_two_worlds_are_listed_and_distinguished(tmp_path):
    file, other = (write_world(tmp_path, frames=0, rate=20) for _ in range(2))
    with World(file) as first, World(other) as second:
        first.runs("steps", "walkers")
        second.runs("steps", "walkers")
        (worlds,) = lines(here(tmp_path, "list", "--json"))
        assert sorted(each["world"] for each in worlds) == sorted([first.name, second.name])
        shown = here(tmp_path, "list").stdout
        assert first.name in shown
        assert second.name in shown
        done = here(tmp_path, "pub", "eNoise")
        assert done.returncode == 2
        assert "choose one with --world" in done.stderr
        assert here(tmp_path, "pub", "eNoise", "--world", second.name).returncode == 0
        for command in ("list", "pause", "resume", "top"):
            answer = ("--json",) if command in ("list", "top") else ()
            for form in (
                (second.name,),
                ("--world", second.name),
                (second.name, "--world", second.name),
            ):
                done = here(tmp_path, command, *form, *answer)
                assert done.returncode == 0, (command, form, done.stderr)
                assert answer or done.stdout.startswith(second.name)
            done = here(tmp_path, command, first.name, "--world", second.name)
            assert (done.returncode, "which world" in done.stderr) == (2, True)
        for line in (
            "pub eNoise", "rate 50", "logs steps", "logs", "echo eStep --count 1",
            "restart steps", "step 2", "resume",
        ):  # fmt: skip
            command, *words = line.split()
            done = here(tmp_path, command, second.name, *words)
            assert done.returncode == 0, (line, done.stderr)
        done = here(tmp_path, "restart", "nowhere", "steps")
        assert "no world 'nowhere' runs" in done.stderr
        assert here(tmp_path, "stop", "--world", second.name).returncode == 0
        assert second.ends() == 0
        assert first.members()
        assert here(tmp_path, "stop", "--connect", first.endpoint()).returncode == 0
        assert first.ends() == 0
        assert "stopped by a person" in "\n".join(first.output)
        first.gone()
        second.gone()


def test_a_name_that_is_taken(world):
    done = minerva(world.folder, "run", world.path)
    assert done.returncode == 2
    pid = world.process.pid
    assert (
        f"a world {world.name!r} runs here already (process {pid}, {world.endpoint()})"
        in done.stderr
    )
    done = minerva(world.folder, "run", world.path, "--name", "another", "--frames", "3", "--json")
    assert json.loads(done.stdout)["world"] == "another"


@pytest.mark.parametrize("listen", ["{endpoint}", "tcp/192.0.2.1:7447", "tcp/127.0.0.1:x", "here"])
def test_an_address_that_cannot_be_listened_at(world, listen):
    listen = listen.format(endpoint=world.endpoint())
    done = minerva(world.folder, "run", world.path, "--name", "other", "--listen", listen)
    assert done.returncode in (1, 2)
    assert listen in done.stderr
    assert "Traceback" not in done.stderr
    assert not (world.folder / "runtime" / "other.json").exists()


def test_a_port_of_one_s_own_choice(tmp_path):
    import socket

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with World(
        write_world(tmp_path, frames=0, rate=20), "--listen", f"tcp/127.0.0.1:{port}"
    ) as world:
        world.runs("steps", "walkers")
        assert world.endpoint() == f"tcp/127.0.0.1:{port}"
        done = minerva(tmp_path, "stop", "--connect", f"tcp/127.0.0.1:{port}")
        assert done.returncode == 0, done.stderr
        assert world.ends() == 0
