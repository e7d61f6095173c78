"""Members from other processes: `minerva attach`, and its errors."""

import signal
import socket
import time

import pytest
from running import MEMBERS, Run, World, alone, eventually, here, write_world

from tests.patience import patience


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    path = write_world(tmp_path_factory.mktemp("attached"), frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers")
        yield world


def attach(world, spec, name, *words):
    return Run(world.folder, "attach", spec, "--name", name, *words)


def takes_part(world, name):
    return eventually(
        lambda: world.members().get(name, {}).get("state") == "present", f"{name} takes part"
    )


def has_left(world, name):
    eventually(lambda: world.members().get(name, {}).get("state") == "left", f"{name} has left")
    before = world.frame
    eventually(lambda: world.members() and world.frame > before, "the world goes on")


@pytest.mark.parametrize(("spec", "role"), [
    ("yard:Screen", "device"), ("yard:Walker", "agents"), ("yard:Steps", "generator"),
    ("yard:Noise", "generator"),
])  # fmt: skip
def test_one_joins_a_running_world_and_leaves_by_ctrl_c(world, spec, role):
    name = f"guest-{role}"
    with attach(world, spec, name) as member:
        takes_part(world, name)
        assert world.members()[name]["roles"] == (role,)
        member.kill(signal.SIGINT)
        assert member.ends() == 0
        assert "Traceback" not in member.text
    has_left(world, name)
    assert f"{name} │ has left" in world.text or f"{name} │ is gone" in world.text


def test_a_view_joins_and_shows(world):
    with attach(world, "yard:Screen", "look", "--said", "true") as member:
        eventually(lambda: len(member.output) > 5, "it shows something")
        member.kill(signal.SIGTERM)
        assert member.ends() == 0
    frames = [int(line.split()[1].rstrip(":")) for line in member.output]
    assert frames == sorted(frames)
    has_left(world, "look")


@pytest.mark.parametrize("spec", ["yard:Screen", "yard:Walker", "yard:Steps"])
def test_one_that_is_killed_is_not_waited_for(world, spec):
    name = f"mortal-{spec.split(':')[1].lower()}"
    with attach(world, spec, name) as member:
        takes_part(world, name)
        member.kill(signal.SIGKILL)
        member.ends()
    has_left(world, name)
    assert f"{name} │ is gone" in world.text


def test_a_frozen_member_is_given_up(tmp_path):
    path = write_world(tmp_path, frames=0, rate=20, bus="soft = 0.2\nhard = 0.8")
    with World(path) as world:
        world.runs("steps", "walkers")
        with attach(world, "yard:Steps", "frozen") as member:
            takes_part(world, "frozen")
            member.kill(signal.SIGSTOP)
            has_left(world, "frozen")
        world.kill(signal.SIGINT)
        assert world.ends() == 130


def test_one_that_hangs_in_its_own_code_ends_by_the_second_ctrl_c(world):
    with attach(world, "yard:Rascal", "stuck", "--deed", "sleeps", "--frame", "0") as member:
        eventually(lambda: "stuck" in world.members(), "it is there")
        member.kill(signal.SIGINT)
        time.sleep(0.1)
        member.kill(signal.SIGINT)
        member.ends(10)
    eventually(lambda: world.members().get("stuck", {}).get("state") != "present", "it is gone")


def test_a_name_that_is_taken_is_refused(world):
    with attach(world, "yard:Screen", "twin"):
        takes_part(world, "twin")
        for name in ("twin", "steps", "coordinator"):
            done = here(world.folder, "attach", "yard:Screen", "--name", name)
            assert done.returncode == 2
            assert f"there is a member {name!r} in the world already" in done.stderr
            assert "--name" in done.stderr
    assert world.members()["twin"]["state"] in ("present", "left")


def test_an_endpoint_without_listener_is_named_fast(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    write_world(tmp_path)
    began = time.monotonic()
    done = here(tmp_path, "attach", "yard:Screen", "--connect", f"tcp/127.0.0.1:{port}",
                   "--world", "yard")  # fmt: skip
    assert done.returncode == 2
    assert f"no answer at tcp/127.0.0.1:{port}: nothing listens" in done.stderr
    assert time.monotonic() - began < patience(15)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("endpoint", [
    "here", "tcp/127.0.0.1", "tcp/127.0.0.1:x", "tcp/:1", "tcp/127.0.0.1:99999", "tpc/127.0.0.1:1",
    "", "tcp/",
])  # fmt: skip
def test_an_invalid_endpoint_is_named_at_once(tmp_path, endpoint):
    write_world(tmp_path)
    done = here(tmp_path, "attach", "yard:Screen", "--connect", endpoint, "--world", "yard")
    assert done.returncode == 2
    assert "is not an endpoint" in done.stderr or "no world" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_world_of_another_name_is_not_joined(world):
    done = here(world.folder, "attach", "yard:Screen", "--world", "elsewhere")
    assert done.returncode == 2
    assert f"no world 'elsewhere' runs on this machine; running: {world.name}" in done.stderr
    done = here(world.folder, "attach", "yard:Screen", "--connect", world.endpoint(),
                   "--world", "elsewhere")  # fmt: skip
    assert done.returncode == 2
    assert "elsewhere" in done.stderr
    assert "Traceback" not in done.stderr


def test_without_a_world_there_is_nothing_to_join(tmp_path):
    write_world(tmp_path)
    done = here(tmp_path, "attach", "yard:Screen")
    assert done.returncode == 2
    assert "no world runs on this machine" in done.stderr


@pytest.mark.parametrize(("words", "problem"), [
    (["yard:Nothing"], "yard has no Nothing"),
    (["nowhere:Screen"], "there is no module nowhere"),
    (["screeen"], "screeen"),
    (["yard:eStep"], "is not a Generator or Device class"),
    (["yard:Screen", "--sid", "true"], "did you mean 'said'"),
    (["yard:Screen", "--said", "maybe"], "said must be true or false"),
    (["yard:Screen", "--name", "a/b"], "cannot name a member"),
    (["yard:Walker", "--said", "true"], "agents, which have no options"),
    (["yard:Rascal"], "needs the option 'deed'"),
])  # fmt: skip
def test_an_invalid_attachment_is_named(world, words, problem):
    done = here(world.folder, "attach", *words)
    assert done.returncode == 2
    assert problem in done.stderr
    assert "Traceback" not in done.stderr


def test_one_of_another_vocabulary_is_refused_with_the_reason(world):
    (world.folder / "strange.py").write_text(
        "from minerva_bus import Agent, Generator\n"
        "class Rain(Generator, events=('eRain',)):\n    pass\n"
        "class Walker(Agent, symbol='AWalker'):\n    x: float = 0.0\n"
    )
    for spec, reason in (
        ("strange:Rain", "the world's vocabulary has no event type eRain"),
        ("strange:Walker", "both must come from the same code"),
    ):
        done = here(world.folder, "attach", spec)
        assert done.returncode == 2
        assert reason in done.stderr


def test_one_that_raises_ends_with_its_failure_and_the_world_goes_on(world):
    with attach(world, "yard:Rascal", "rascal", "--deed", "raises") as member:
        assert member.ends() == 1
    has_left(world, "rascal")
    assert "rascal │ failed in frame" in world.text


def test_attached_members_end_with_their_world(tmp_path):
    with World(write_world(tmp_path, MEMBERS, frames=0, rate=20)) as world:
        world.runs("steps", "walkers")
        with (
            attach(world, "yard:Screen", "look") as first,
            attach(world, "yard:Walker", "help") as second,
        ):
            takes_part(world, "look")
            takes_part(world, "help")
            world.kill(signal.SIGINT)
            assert world.ends() == 130
            assert [first.ends(), second.ends()] == [0, 0]
            assert "the world has ended" in first.text


def test_attached_members_notice_the_death_of_a_world(tmp_path):
    with World(write_world(tmp_path, MEMBERS, frames=0, rate=20)) as world:
        world.runs("steps", "walkers")
        with attach(world, "yard:Screen", "look") as member:
            takes_part(world, "look")
            world.kill()
            member.ends()
            assert "; giving up" in member.text


def test_a_host_is_emptied_and_the_string_is_the_same(tmp_path):
    path = write_world(tmp_path, frames=120, rate=50)
    with World(path, "--json") as world, world.client() as asked:
        world.runs("steps", "walkers")
        asked.operator.pause()
        done = here(tmp_path, "drain", "walkers")
        assert done.returncode == 2
        assert "no other host offers AWalker" in done.stderr
        assert "'steps' hosts no agents" in here(tmp_path, "drain", "steps").stderr
        with attach(world, "yard:Walker", "help"):
            takes_part(world, "help")
            done = here(tmp_path, "drain", "walkers")
            assert done.stdout == f"{world.name}: the agents of walkers move to help\n"
            assert world.members()["walkers"]["state"] == "drained"
            before = world.members()["walkers"]["last_reply"]
            asked.operator.step(20)
            eventually(lambda: not asked.operator.status().left, "frames without it")
            assert world.members()["walkers"]["last_reply"] <= before + 1
            assert world.members()["help"]["last_reply"] > before + 10
            asked.operator.resume()
            summary = world.summary()
    assert summary["digest"] == alone(path)["digest"]


def test_a_host_that_helps_for_a_while_leaves_no_trace_in_the_string(tmp_path):
    path = write_world(tmp_path, frames=200, rate=50)
    with World(path, "--json") as world, world.client() as asked:
        world.runs("steps", "walkers")
        for way, code in ((signal.SIGKILL, -signal.SIGKILL), (signal.SIGINT, 0)):
            asked.operator.pause()  # on a slow machine the world would end before a member joins
            with attach(world, "yard:Walker", "help") as helper:
                takes_part(world, "help")
                asked.operator.step(20)
                eventually(lambda: not asked.operator.status().left, "it has helped")
                asked.operator.resume()
                helper.kill(way)
                assert helper.ends() == code
        summary = world.summary()
    assert summary["digest"] == alone(path)["digest"]
