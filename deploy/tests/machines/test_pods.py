"""The manifests' pods with `podman kube play`: the coordinator and two hosts.

The hosts share one certificate. A pod follows the manifest's template, with folders instead of
secrets and claims, a fixed address instead of the service name, and its own name in its arguments.
It omits probes, resources and spread constraints, which require a kubelet or several nodes.
"""

import re
import shutil
import signal
import sys
import urllib.request
from copy import deepcopy

import pytest
import yaml

from deploy.tests.deployed import PODS, README
from deploy.tests.machines.conftest import IMAGE, needs, run
from tests.runtime.running import eventually

pytestmark = [pytest.mark.deploy, pytest.mark.timeout(900)]
NETWORK, SUBNET, ADDRESS = "minerva-pods", "10.89.77.0/24", "10.89.77.2"
KUBELET = ("startupProbe", "livenessProbe", "readinessProbe", "resources")


def pod(name, manifest, folders):
    """A Pod that podman can run.

    Args:
        name: name of the pod.
        manifest: the StatefulSet or Deployment that has its template.
        folders: the folder of each volume for a secret or a claim.

    """
    spec = deepcopy(PODS[manifest])
    for container in spec["containers"]:
        container |= {"image": f"localhost/{IMAGE}", "imagePullPolicy": "Never"}
        container["args"] = [word.replace("$(NAME)", name) for word in container["args"]]
        for key in KUBELET:
            container.pop(key, None)
    for key in ("topologySpreadConstraints", "automountServiceAccountToken", "enableServiceLinks"):
        spec.pop(key, None)
    spec["volumes"] = [
        {"name": volume, "hostPath": {"path": str(folder), "type": "Directory"}}
        for volume, folder in folders.items()
    ]
    spec["hostAliases"] = [{"ip": ADDRESS, "hostnames": ["coordinator"]}]
    spec["restartPolicy"] = "Never"
    return {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": name}, "spec": spec}


def secret(keys, name):
    """The files of a secret that the page's command creates from the folder of keys."""
    (files,) = re.findall(rf"minerva create secret generic {name}-keys \$\((.*)\)", README)
    folder = keys.parent / f"{name}-keys"
    folder.mkdir()
    for word in run("bash", "-ec", files, cwd=keys.parent).split():
        shutil.copy(keys.parent / word.removeprefix("--from-file="), folder)
    return folder


@pytest.fixture
def play(podman, image, tmp_path):
    """A function that starts a pod of a manifest."""
    needs("catatonit")
    section = README.partition("## Kubernetes")[2].partition("\n## ")[0]
    commands = "\n".join(line for line in section.splitlines() if line.startswith("minerva keys"))
    assert commands.count("minerva keys") == 2
    minerva = f'minerva() {{ {sys.executable} -m minerva_bus.cli.main "$@"; }}'
    run("bash", "-ec", f"{minerva}\n{commands}", cwd=tmp_path)
    folders = {name: secret(tmp_path / "keys", name) for name in ("coordinator", "hosts")}
    podman("network", "rm", "--force", NETWORK)  # An interrupted run leaves it behind.
    podman("network", "create", "--subnet", SUBNET, NETWORK)

    def start(name, manifest, *options):
        state, tmp = tmp_path / f"{name}-state", tmp_path / f"{name}-tmp"
        state.mkdir(exist_ok=True)
        shutil.rmtree(tmp, ignore_errors=True)
        tmp.mkdir()
        volumes = {"keys": folders[manifest], "state": state, "tmp": tmp}
        mounted = {mount["name"] for mount in PODS[manifest]["containers"][0]["volumeMounts"]}
        made = pod(name, manifest, {key: volumes[key] for key in sorted(mounted)})
        run("chown", "--recursive", "10001:10001", tmp_path)
        tmp_path.chmod(0o755)
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(made))
        podman("kube", "play", "--network", NETWORK, *options, tmp_path / f"{name}.yaml")

    yield start
    podman("pod", "rm", "--all", "--force", "--time", "0")
    podman("network", "rm", "--force", NETWORK)


def answer(path):
    try:
        with urllib.request.urlopen(f"http://{ADDRESS}:9464/{path}") as page:
            return page.read().decode()
    except OSError:
        return ""


def members(podman):
    """The state of each member, from `minerva list` in the coordinator's pod."""
    lines = podman("exec", "coordinator-0-world", "minerva", "list").splitlines()[2:]
    return {line.split()[0]: line.split()[1] for line in lines}


def test_pods_of_hosts_join_leave_and_the_coordinator_resumes(play, podman):
    play("coordinator-0", "coordinator", "--ip", ADDRESS)
    eventually(lambda: answer("live"), "the coordinator answers", 120)
    for name in ("hosts-5d8c7-x2x7k", "hosts-5d8c7-p9q4z"):
        play(name, "hosts")
        eventually(lambda name=name: members(podman).get(name) == "present", f"{name} joins", 60)
    eventually(lambda: answer("ready"), "frames run", 60)
    podman("pod", "stop", "--time", "20", "hosts-5d8c7-x2x7k")
    eventually(lambda: members(podman).get("hosts-5d8c7-x2x7k") == "left", "the host has left", 60)
    assert members(podman)["hosts-5d8c7-p9q4z"] == "present"
    podman("kill", "--signal", signal.SIGKILL.name, "coordinator-0-world")
    podman("pod", "rm", "--force", "coordinator-0")
    play("coordinator-0", "coordinator", "--ip", ADDRESS)
    eventually(
        lambda: "continuing from frame" in podman.said("coordinator-0-world"), "resumes", 120
    )
    eventually(lambda: answer("ready"), "frames run again", 60)
    eventually(
        lambda: members(podman).get("hosts-5d8c7-p9q4z") == "present", "the host is back", 60
    )


def test_pods_write_only_where_they_have_a_volume(play, podman):
    play("coordinator-0", "coordinator", "--ip", ADDRESS)
    eventually(lambda: answer("live"), "the coordinator answers", 120)
    script = (
        "id -u; for place in / /etc/minerva /opt/minerva /usr /etc/minerva/keys; do"
        " touch $place/no 2>/dev/null && echo can write $place; done; touch /tmp/yes"
        " /var/lib/minerva/yes"
    )
    written = podman("exec", "coordinator-0-world", "sh", "-c", script)
    assert written.split() == ["10001"]
