"""The literal commands of the compose file of regions: a coordinator, four regions, two hosts."""

import json
import re
import shutil
import signal

import pytest

from minerva_bus.runtime.client import Client
from minerva_bus.security.certificates import Wanted
from minerva_bus.security.keys import KeyFolder
from tests.deploy.deployed import COMPOSED_REGIONS
from tests.runtime.running import Run, World, eventually

pytest.importorskip("prometheus_client")
pytest.importorskip("mcap")

SERVICES = COMPOSED_REGIONS["services"]
REGIONS = [f"region-{number}" for number in range(4)]
HOSTS = ["rabbits-host-0", "rabbits-host-1"]


@pytest.fixture
def tmp_path(tmp_path_factory):
    """A short path: sockets of regions are below it, and their names have at most 100 bytes."""
    return tmp_path_factory.mktemp("d")


def words(name, **places):
    """The command of a container, with paths and addresses of this machine."""
    arguments = {each.partition("=")[0]: each for each in SERVICES[name]["command"]}
    assert {f"--{place}" for place in places} <= set(arguments)
    here = {f"--{place}": f"--{place}={at}" for place, at in places.items()}
    return [*{**arguments, **here}.values()]


class Containers:
    """The processes of containers, each with its own secrets, as a context that ends them."""

    def __init__(self, folder):
        self.folder, self.runs = folder, []
        self.keys = KeyFolder(folder / "keys")
        self.keys.init(["localhost"])
        for region in REGIONS:
            self.keys.issue(region, Wanted(("region",), hosts=("localhost",)))
        self.keys.issue("rabbits", Wanted(("agent",), family=True))

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        for run in self.runs:
            run.__exit__(*exc)

    def start(self, name, **places):
        if "secrets" in SERVICES[name]:
            places["keys"] = secrets = self.folder / name
            secrets.mkdir()
            for secret in SERVICES[name]["secrets"]:
                shutil.copy(self.keys.folder / secret["source"], secrets)
        self.runs.append(Run(self.folder, *words(name, **places)))
        return self.runs[-1]


def endpoint_of(region):
    def line():
        return next((each for each in region.lines if "listens at" in each), "")

    return eventually(line, region.text).partition("listens at ")[2].partition(";")[0]


def test_hosts_of_regions_evolve_agents(tmp_path):
    with Containers(tmp_path) as containers:
        places = {"keys": "keys", "journal": "journal", "metrics": "127.0.0.1:0"}
        world = containers.start("coordinator", listen="tls/127.0.0.1:0", **places)
        line = json.loads(world.says("listens at tls/"))["message"]
        door = re.search(r"listens at (\S+);", line)[1].replace("127.0.0.1", "localhost")
        own = {"link": "tls/localhost:0", "listen": "tls/localhost:0"}
        regions = [containers.start(region, connect=door, **own) for region in REGIONS]
        hosts = [
            containers.start(host, connect=endpoint_of(region))
            for host, region in zip(HOSTS, regions, strict=False)
        ]
        world.name = "meadow"
        local = eventually(lambda: World.registered(world), "it is there")["endpoint"]

        def agents():
            with Client(local, "meadow") as asked:
                members = asked.operator.status().members
            return {each.name: each.figures["agents"] for each in members if "agents" in each.roles
                    and "agents" in each.figures}  # fmt: skip

        names = {f"{region}.{host}" for region, host in zip(REGIONS, HOSTS, strict=False)}
        eventually(lambda: agents().keys() == names, "\n".join(each.text for each in hosts))
        world.kill(signal.SIGTERM)
        assert world.ends() == 130, world.text
        assert [each.ends() for each in (*regions, *hosts)] == [0] * 6
