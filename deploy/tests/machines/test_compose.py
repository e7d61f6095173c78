"""The compose file with podman-compose: each member in its own container, with its own key."""

import os
import signal
import sys
import urllib.request

import pytest

from deploy.tests.deployed import COMPOSE, README
from deploy.tests.machines.conftest import ROOT, needs, run
from tests.runtime.running import eventually

pytestmark = [pytest.mark.deploy, pytest.mark.timeout(900)]
OURS = [name for name, container in COMPOSE["services"].items() if "profiles" not in container]


@pytest.fixture
def compose(podman, image, tmp_path):
    """podman-compose for the project, with the keys from the page's commands."""
    needs("podman-compose", "aardvark-dns")
    text = README.partition("## Containers")[2].split("```")[1]
    script = "\n".join(line for line in text.splitlines() if "minerva keys" in line)
    assert script.count("minerva keys") == 4
    minerva = f'minerva() {{ {sys.executable} -m minerva_bus.cli.main "$@"; }}'
    run("bash", "-ec", f"{minerva}\n{script}", cwd=tmp_path)
    environment = {**podman.environment, "UID": "10001", "GID": "10001",
                   "KEYS": str(tmp_path / "keys")}  # fmt: skip
    run("chown", "--recursive", "10001:10001", tmp_path / "keys")

    def call(*words):
        return run("podman-compose", "--file", ROOT / "deploy/docker/compose.yaml", *words,
                   env=environment, cwd=ROOT)  # fmt: skip

    yield call
    call("down", "--volumes")


def ready():
    try:
        with urllib.request.urlopen("http://127.0.0.1:9464/ready") as answer:
            return answer.read().decode()
    except OSError:
        return ""


def listed(podman):
    """The state of each member, from `minerva list` in the coordinator's container."""
    lines = podman("exec", "docker_coordinator_1", "minerva", "list").splitlines()[2:]
    return {line.split()[0]: line.split()[1] for line in lines}


def test_members_in_containers_join_rejoin_and_leave(compose, podman):
    compose("up", "--detach", "--no-build", *OURS)
    eventually(ready, "all members are there", 120)
    assert listed(podman) == dict.fromkeys(set(OURS) - {"coordinator"}, "present")
    inside = podman("inspect", "--format={{.State.Pid}}", "docker_gSpeed_1").strip()
    os.kill(int(inside), signal.SIGKILL)
    eventually(lambda: inside != podman("inspect", "--format={{.State.Pid}}", "docker_gSpeed_1"),
               "it restarts")  # fmt: skip
    eventually(lambda: ready() and listed(podman)["gSpeed"] == "present", "it is there again", 60)
    podman("stop", "--time=20", "docker_robots_1")
    assert eventually(lambda: listed(podman).get("robots") == "left", "it has left")
