"""Members that are killed, raise, hang or leave, on a real bus; the result is the same."""

import json
import os
import re
import signal
import socket

import pytest
from running import (
    ALL_KINDS,
    MEMBERS,
    STRING,
    World,
    alone,
    eventually,
    minerva,
    summary,
    write_world,
)

RASCAL = """
[process.rascal]
service = "yard:Rascal"
deed = "{deed}"
{more}
"""


COUNTING = """
import yard


class Rascal(yard.Rascal):
    def generate(self, tick):
        self.asked = tick.number
        return super().generate(tick)
"""


def rascal(deed, more=""):
    return MEMBERS + RASCAL.format(deed=deed, more=more)


def test_a_killed_member_is_named_and_restarted_with_the_same_string(tmp_path):
    path = write_world(tmp_path, ALL_KINDS, frames=0, rate=20)
    names = ("steps", "walkers", "water", "eye", "screen", "noise")
    with World(path, "--json") as world:
        for name in names:
            pid = world.runs(*names)[name]
            os.kill(pid, signal.SIGKILL)
            world.says(f"{name} │ was killed by SIGKILL; restart 1 of 5 in")

            def successor(name=name, pid=pid):
                member = world.members().get(name)
                return member and member["pid"] != pid and member["state"] == "present"

            eventually(successor, f"a successor of {name}")
            then = {"screen": "", "noise": "; the world continues"}.get(
                name, "; the world waits for it"
            )
            assert re.search(rf"^{name} │ is gone{then}$", world.text, re.M)
        assert minerva(tmp_path, "stop", path.stem).returncode == 0
        ended = world.summary()
        world.gone()
    words = ("--in-process", "--rate", 0, "--frames", ended["frames"], "--json")
    assert ended["digest"] == summary(minerva(tmp_path, "run", path, *words))["digest"]


def test_a_member_that_raises_reports_its_line_and_restarts(tmp_path):
    memory = tmp_path / "memory"
    members = rascal("raises", f'memory = "{memory}"').replace("yard:Rascal", "counting:Rascal")
    path = write_world(tmp_path, members)
    (tmp_path / "counting.py").write_text(COUNTING)
    with World(path, "--json") as world:
        world.summary()
        text = world.text
    assert memory.exists()
    assert re.search(
        "rascal │ failed in frame 5: Rascal.generate: ZeroDivisionError: the rascal's own fault\n"
        r"rascal │   .*yard.py:\d+, in Rascal.raises\n"
        r'rascal │     raise ZeroDivisionError\("the rascal\'s own fault"\)',
        text,
    )
    assert "rascal │ failed; restart 1 of 5 in 0.05 s" in text
    assert text.count("rascal │ Rascal of [process.rascal] changes asked and has no `save`") == 1
    assert "Traceback" not in text


def test_an_agent_that_raises_is_named_with_its_event_and_frame(tmp_path):
    memory = tmp_path / "memory"
    members = MEMBERS + '\n[process.fragile]\nagents = "yard:Fragile"\n'
    string = f"{STRING} · AFragile#f<memory={str(memory)!r}>".replace("'", '"')
    path = write_world(tmp_path, members, string)
    calm = write_world(tmp_path, members, string.replace(str(memory), ""))
    with World(path, "--json") as world:
        summary = world.summary()
        text = world.text
    assert re.search(
        r"fragile │ failed in frame 3: Fragile\.\w+ of AFragile#f at eStep<count=\d+>:"
        r" KeyError: 'a lost key'",
        text,
    )
    assert 'raise KeyError("a lost key")' in text
    assert summary["frames"] == 30
    with World(calm, "--json") as world:
        assert world.ends() == 1
        assert "with the same error in the same frame" in world.text
        assert "restart 2 of" not in world.text


@pytest.mark.parametrize(("policy", "code", "line"), [
    ("stop", 1, "rascal │ ended with exit code 7; the world stops"),
    ("ignore", 0, "rascal │ ended with exit code 7; continuing without it"),
])  # fmt: skip
def test_the_world_file_decides_about_failures(tmp_path, policy, code, line):
    path = write_world(tmp_path, rascal("exits", f'on_failure = "{policy}"'))
    with World(path) as world:
        assert world.ends() == code
        assert line in world.text
        shown = "\n".join(world.output)
    assert ("30 frames" in shown) is (policy == "ignore")


@pytest.mark.parametrize("options", [("--rate", "0"), ("--frames", "0"), ("--in-process",)])
def test_a_view_whose_port_is_in_use_fails_the_run(tmp_path, options):
    # A world with shapes, which this view needs.
    minerva(tmp_path, "new", "world", "dots")
    path = tmp_path / "dots" / "dots.toml"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = minerva(tmp_path, "run", path, "--view", f"web:port={port}", *options)
    assert done.returncode == 1
    # Once in the log, and once in the summary.
    assert done.stderr.count(str(port)) == 1, done.stderr
    assert done.stdout.count(str(port)) <= 1, done.stdout
    assert f"port {port} of 127.0.0.1 is in use; use another one" in done.stderr


def test_in_the_end_a_world_stops_when_one_fails_again_and_again(tmp_path):
    path = write_world(tmp_path, rascal("exits", "restarts = 2"))
    with World(path) as world:
        assert world.ends() == 1
        text = world.text
    assert "rascal │ ended with exit code 7; restart 2 of 2 in 0.10 s" in text
    assert "rascal │ ended with exit code 7, 3 times in a row; the world stops" in text


def test_one_that_ends_by_itself_is_started_again_and_not_for_ever(tmp_path):
    """It exits with code 0 before it joins, like a command that is not a member at all."""
    members = MEMBERS + '\n[process.stranger]\ncommand = ["true"]\nrestarts = 2\n'
    path = write_world(tmp_path, members)
    with World(path) as world:
        assert world.ends() == 1
        assert "stranger" in world.text
        assert "the world stops" in world.text


@pytest.mark.parametrize("deed", ["loops", "sleeps"])
def test_one_that_hangs_is_named_killed_and_started_again(tmp_path, deed):
    memory = tmp_path / "memory"
    path = write_world(tmp_path, rascal(deed, f'memory = "{memory}"'), bus="soft = 0.2\nhard = 1.0")
    undisturbed = alone(write_world(tmp_path))
    with World(path, "--json") as world:
        ended = world.summary()
        text = world.text
    assert re.search(
        r"rascal │ frame 5 \(events\) has been waiting for it for 0\.\d s;"
        r" it will be restarted in \d(\.\d)? s", text
    )  # fmt: skip
    assert re.search(r"rascal │ no answer for \d s: killing it", text)
    assert "rascal │ was killed by SIGKILL; restart 1 of 5" in text
    assert "│ no answer" in text
    assert text.count("killing it") == 1
    assert ended["digest"] == undisturbed["digest"]


@pytest.mark.parametrize("name", ["steps", "walkers"])
def test_one_that_is_frozen_is_killed_and_started_again(tmp_path, name):
    path = write_world(tmp_path, frames=60, rate=30, bus="soft = 0.2\nhard = 1.0")
    undisturbed = alone(path)
    with World(path, "--json") as world:
        os.kill(world.runs("steps", "walkers")[name], signal.SIGSTOP)
        world.says(name, "has been waiting for it")
        world.says(name, "killing it")
        ended = world.summary()
        world.gone()
    assert ended["digest"] == undisturbed["digest"]


def test_one_that_hangs_for_good_is_killed_again_and_again_until_the_world_stops(tmp_path):
    path = write_world(tmp_path, rascal("loops", "restarts = 1"), bus="soft = 0.1\nhard = 0.5")
    with World(path) as world:
        assert world.ends() == 1
        # The line that it executes, and so whether it is the same one, differs between runs.
        assert re.search(r"rascal │ .*, 2 times in a row; the world stops", world.text)
        world.gone()


def test_output_of_members_is_shown_completely_with_names(tmp_path):
    path = write_world(tmp_path, rascal("chatters"))
    with World(path) as world:
        assert world.ends() == 0
        lines = [line for line in world.lines if line.startswith("rascal │ line ")]
    assert [int(line.split()[3]) for line in lines] == list(range(3000))


@pytest.mark.parametrize(
    ("error", "times"), [("MisuseError", ""), ("RecordingError", ", 2 times in a row")]
)
def test_a_member_that_cannot_take_part_names_the_reason_in_the_summary(tmp_path, error, times):
    """It starts again only where another attempt may succeed."""
    (tmp_path / "unready.py").write_text(
        "from minerva_bus import Generator\nfrom minerva_bus.errors import MisuseError\n"
        "from minerva_bus.log.recordings import RecordingError\n"
        "class Lidar(Generator):\n    def joined(self, info):\n"
        f"        raise {error}('the vocabulary has no eScan')\n"
        "    def generate(self, tick):\n        return ()\n"
    )
    lidar = '[process.lidar]\nservice = "unready:Lidar"\nrestarts = 1\n'
    path = write_world(tmp_path, lidar)
    done = minerva(tmp_path, "run", path, "--json")
    reason = "cannot take part: the vocabulary has no eScan"
    assert done.returncode == 1
    assert json.loads(done.stdout)["ended"] == f"lidar {reason}"
    assert done.stderr.count(reason) == 1
    assert f"lidar │ cannot take part{times}; the world stops" in done.stderr


def test_a_printed_line_is_not_a_report(tmp_path):
    (tmp_path / "liar.py").write_text(
        "import os\nfrom minerva_bus import Generator\n"
        "class Lidar(Generator):\n    def generate(self, tick):\n"
        "        print('lidar cannot take part: the moon is full', flush=True)\n"
        "        os._exit(3)\n"
    )
    lidar = '[process.lidar]\nservice = "liar:Lidar"\nrestarts = 1\n'
    done = minerva(tmp_path, "run", write_world(tmp_path, lidar), "--json")
    assert done.returncode == 1
    assert json.loads(done.stdout)["ended"].startswith("lidar ended with exit code 3")
    # It is output of the process, which is shown each time.
    assert done.stderr.count("lidar │ lidar cannot take part: the moon is full") == 2
