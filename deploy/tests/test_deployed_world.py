"""The literal commands of the Kubernetes manifests: a coordinator and two pods."""

import json
import re
import shutil
import signal

import pytest

from deploy.tests.deployed import PODS
from minerva_bus.runtime.operator_client import Client
from minerva_certificates import AuthorityFolder, Wanted
from tests.runtime.running import Run, World, eventually

pytest.importorskip("prometheus_client")
pytest.importorskip("mcap")

PODS_NAMES = ("hosts-5d8c7b9f4-x2x7k", "hosts-5d8c7b9f4-q9l4d")


def words(pod, **places):
    """The command of the pod's container, with paths and addresses of this machine."""
    (container,) = PODS[pod]["containers"]
    arguments = {argument.partition("=")[0]: argument for argument in container["args"]}
    assert {f"--{name}" for name in places} <= set(arguments)
    return list(
        {**arguments, **{f"--{name}": f"--{name}={at}" for name, at in places.items()}}.values()
    )


def test_pods_join_are_given_agents_and_go(tmp_path):
    keys = AuthorityFolder(tmp_path / "keys")
    keys.init()
    keys.issue("hosts", Wanted(("agent",), family=True))
    secret = tmp_path / "secret"
    secret.mkdir()
    for name in ("ca.pem", "hosts.pem", "hosts.key"):
        shutil.copy(keys.folder / name, secret)
    run = words("coordinator", listen="tls/127.0.0.1:0", keys="keys", journal="journal",
                metrics="127.0.0.1:0")  # fmt: skip
    with Run(tmp_path, *run) as world:
        line = json.loads(world.says("listens at tls/"))["message"]
        door = re.search(r"listens at (\S+);", line).group(1)
        world.name = "robot"
        local = eventually(lambda: World.registered(world), "it is there")["endpoint"]

        def member(name):
            with Client(local, "robot") as asked:
                return {member.name: member for member in asked.operator.status().members}.get(name)

        def pod(name):
            return Run(tmp_path, *words("hosts", name=name, connect=door, keys=secret))

        with pod(PODS_NAMES[0]) as first, pod(PODS_NAMES[1]) as second:
            for name in PODS_NAMES:
                eventually(lambda n=name: (its := member(n)) and its.state == "present", name)
            seen = max(member(name).last_reply for name in PODS_NAMES)
            eventually(lambda: max(member(n).last_reply for n in PODS_NAMES) > seen + 3, "agents")
            first.kill(signal.SIGTERM)
            assert first.ends() == 0, first.text
            eventually(lambda: member(PODS_NAMES[0]).state == "left", "it is gone")
            assert member(PODS_NAMES[1]).state == "present"
            world.kill(signal.SIGTERM)
            assert world.ends() == 130, world.text
            assert second.ends() == 0, second.text
