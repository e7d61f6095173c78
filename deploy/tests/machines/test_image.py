"""The image builds and runs worlds: with a read-only root, killed, and from its journal."""

import json
import re

import pytest

from tests.runtime.running import eventually, here, summary

pytestmark = [pytest.mark.deploy, pytest.mark.timeout(900)]
SMALL = ("--read-only", "--cap-drop=ALL", "--security-opt=no-new-privileges")
WORLD = ("run", "robot", "--until=", "--json")


def frame_of(podman, container):
    """The frame number from `minerva list` in a container."""
    match = re.search(r"\bframe (\d+)", podman("exec", container, "minerva", "list"))
    return int(match[1]) if match else -1


@pytest.mark.parametrize(
    "tmpfs", [(), ("--read-only-tmpfs=false", "--tmpfs=/tmp")], ids=["plain", "named"]
)
def test_a_world_runs_with_a_read_only_root(podman, image, tmp_path, tmpfs):
    """The page documents plain `--read-only`; podman then provides a /tmp."""
    output = podman("run", "--rm", *SMALL, *tmpfs, image, *WORLD, "--frames", 30)
    alone = summary(here(tmp_path, *WORLD, "--frames", 30, "--in-process"))
    assert json.loads(output.splitlines()[-1])["digest"] == alone["digest"]


def test_nothing_else_is_writable_and_no_process_is_root(podman, image):
    script = (
        "id -u; for place in / /etc/minerva /opt/minerva /usr; do"
        " touch $place/no 2>/dev/null && echo can write $place; done; true"
    )
    output = podman("run", "--rm", *SMALL, "--entrypoint=sh", image, "-c", script)
    assert output.split() == ["10001"]


def test_a_killed_container_goes_on_from_its_journal(podman, image, tmp_path):
    journal = ("--volume=journal:/var/lib/minerva", image, *WORLD, "--journal", "journal")
    podman("run", "--detach", "--name=first", *SMALL, *journal, "--frames=400", "--rate=40")
    eventually(lambda: frame_of(podman, "first") > 20, "it runs")
    podman("kill", "--signal=KILL", "first")
    output = podman("run", "--name=second", *SMALL, *journal, "--frames=400", "--rate=0")
    answer = json.loads(output.splitlines()[-1])
    alone = summary(here(tmp_path, *WORLD, "--frames", 400, "--in-process"))
    assert (answer["frames"], answer["digest"]) == (400, alone["digest"])
    assert answer["frames_before"] > 0


def test_sigterm_ends_a_container_in_order(podman, image):
    podman("run", "--detach", "--name=asked", *SMALL, image, *WORLD, "--rate=10")
    eventually(lambda: frame_of(podman, "asked") > 0, "it runs")
    podman("stop", "--time=20", "asked")
    assert podman("inspect", "--format={{.State.ExitCode}}", "asked").strip() == "130"
    assert '"ended": "terminated"' in podman.said("asked")
