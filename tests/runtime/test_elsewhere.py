"""A world whose members other processes start, monitored over HTTP and by its log lines."""

import json
import re
import signal
import urllib.request
from types import SimpleNamespace
from urllib.error import HTTPError

import pytest

from minerva_bus.errors import MisuseError
from minerva_bus.launch import run_outputs
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides, WatchSettings
from tests.runtime.running import Run, World, eventually, here, write_world

pytest.importorskip("prometheus_client")

MEMBERS = """
[process.steps]
service = "yard:Steps"

[process.walkers]
agents = "yard:Walker"
elsewhere = true
"""
FIELDS = ["time", "level", "world", "frame", "member", "message"]


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("elsewhere")
    path = write_world(folder, MEMBERS, frames=0, rate=20)
    with World(path, "--metrics", "127.0.0.1:0", "--log-format", "json") as running:
        yield running


@pytest.fixture(scope="module")
def url(world):
    return url_in(json.loads(world.says("metrics at http://"))["message"])


def url_in(line):
    match = re.search(r"http://\S+(?=/metrics)", line)
    assert match is not None, line
    return match[0]


def apart(world):
    """Run `minerva metrics` in a separate process."""
    words = ("metrics", "--listen", "127.0.0.1:0", "--connect", world.endpoint())
    return Run(world.folder, *words)


def attached(world):
    return Run(
        world.folder, "attach", world.path, "--process", "walkers", "--connect", world.endpoint()
    )


def got(url, path):
    try:
        with urllib.request.urlopen(f"{url}/{path}") as reply:
            return reply.status, reply.read().decode()
    except HTTPError as refused:
        return refused.code, refused.read().decode()


def test_a_world_waits_for_a_member_elsewhere_and_accepts_its_successor(world, url):
    assert got(url, "live")[0] == 200
    eventually(lambda: "waiting for walkers to join" in got(url, "ready")[1], "only for them")
    assert got(url, "ready")[0] == 503
    with attached(world):
        eventually(lambda: got(url, "ready")[0] == 200, "frames")
        assert "minerva_events_total" in got(url, "metrics")[1]
    eventually(lambda: "waiting for walkers" in got(url, "ready")[1], "the dead one is missed")
    assert got(url, "ready")[0] == 503
    refused = here(world.folder, "restart", "walkers", "--connect", world.endpoint())
    assert refused.returncode == 2
    assert "walkers runs on another machine: restart it there" in refused.stderr
    with attached(world) as again:
        eventually(lambda: got(url, "ready")[0] == 200, "frames again")
        metrics = got(url, "metrics")[1]
        assert f'minerva_restarts_total{{member="walkers",world="{world.name}"}} 1.0' in metrics
        assert f'minerva_restarts_total{{member="steps",world="{world.name}"}} 0.0' in metrics
        logged = here(world.folder, "logs", "--json", "--connect", world.endpoint())
        lines = [json.loads(line) for line in logged.stdout.splitlines()]
        assert any(line["member"] == "walkers" and line["level"] == "warning" for line in lines)
        assert all(list(line) == FIELDS for line in lines)
        with apart(world) as other:
            its = url_in(other.says("metrics at http://"))
            assert got(its, "ready")[0] == 200
            world.kill(signal.SIGTERM)
            assert world.ends() == 130
            assert again.ends() == 0
            eventually(lambda: got(its, "live")[0] == 503, "it is seen that the world is gone")
            assert f'minerva_up{{world="{world.name}"}} 0.0' in got(its, "metrics")[1]
            other.kill(signal.SIGTERM)
            assert other.ends() == 0
    printed = [json.loads(line) for line in world.lines]
    assert all(list(line) == FIELDS and line["world"] == world.name for line in printed)
    assert [
        line for line in printed if "to be attached from other machines: walkers" in line["message"]
    ]
    assert {line["message"] for line in lines} <= {line["message"] for line in printed}
    assert json.loads("\n".join(world.output))["ended"] == "terminated"


def test_a_coordinator_only_run_waits_for_all_members(tmp_path):
    path = write_world(tmp_path, MEMBERS)
    file = read_world_file(path, Overrides(coordinator_only=True))
    assert [process.elsewhere for process in file.processes] == [True, True]
    assert [process.elsewhere for process in read_world_file(path).processes] == [False, True]
    refused = here(tmp_path, "run", path, "--in-process")
    assert "walkers runs elsewhere: run without --in-process" in refused.stderr


def test_a_process_that_the_file_does_not_have_cannot_be_attached(tmp_path):
    path = write_world(tmp_path, MEMBERS)
    refused = here(tmp_path, "attach", path, "--process", "walker", "--connect", "tcp/127.0.0.1:9")
    assert "no process 'walker'; did you mean 'walkers'?" in refused.stderr


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('[metrics]\nlisten = "9464"', "metrics.listen must be HOST:PORT"),
        ('[metrics]\nlissen = "x:1"', "lissen is unknown; did you mean 'listen'?"),
        ('[log]\nformat = "xml"', "log.format must be one of text, json"),
        ("[placement]\nAWalkr = ['a']", "AWalkr is not an agent kind of this world; did you mean"),
        ("[placement]\nAWalker = [1]", "AWalker must be a list of hosts"),
        ("[placement]\nAWalker = []", "AWalker allows nothing"),
        ("[placement]\nagents_per_host = -1", "agents_per_host must be at least 0"),
        ("[placement]\nAWalker = { nigh = 'x' }", "nigh is unknown"),
    ],
)
def test_an_error_in_a_world_file_has_its_position(tmp_path, text, problem):
    path = write_world(tmp_path, f"{MEMBERS}\n{text}\n")
    done = here(tmp_path, "check", path)
    assert done.returncode == 1
    assert problem in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


def test_placement_is_read(tmp_path):
    text = '[placement]\nagents_per_host = 9\nAWalker = "walkers-*"\nAFragile = { near = "steps" }'
    placement = read_world_file(write_world(tmp_path, f"{MEMBERS}\n{text}\n")).world.placement
    assert placement.agents_per_host == 9
    assert placement.rules["AWalker"].only == ("walkers-*",)
    assert placement.neighbours == {"steps"}


def test_errors_at_the_start_are_json_lines_too(tmp_path):
    path = write_world(tmp_path, MEMBERS.replace("elsewhere = true", ""), frames=3)
    run = here(tmp_path, "run", path, "--in-process", "--log-format", "json", "--metrics", "x:x")
    assert run.returncode == 2
    done = here(tmp_path, "run", path, "--in-process", "--log-format", "json")
    assert json.loads(done.stdout)["frames"] == 3


def test_metrics_need_an_extension_that_serves_them(monkeypatch):
    monkeypatch.setattr(run_outputs, "entries", lambda group: {})
    file = SimpleNamespace(watch=WatchSettings("127.0.0.1:9464"))
    with pytest.raises(MisuseError, match="need an extension"):
        run_outputs.monitored(file, None, None)
