"""Hosts of the agents of regions, on other machines: they attach to their region, and may go."""

import signal

import pytest
from running import (  # pyright: ignore[reportMissingImports]
    MEMBERS,
    Run,
    World,
    eventually,
    here,
    summary,
)
from secured import keyed_world, secured_endpoint

from minerva_bus.log.reader import Record

REGIONS = "region-0", "region-1"


@pytest.fixture
def tmp_path(tmp_path_factory):
    """A short path: sockets of regions are below it, and their names have at most 100 bytes."""
    return tmp_path_factory.mktemp("h")


HOSTS = '\n[regions]\ncount = 2\nhosts = ["walkers"]\n'


def certificates(*hosts):
    return {
        **{name: {"roles": ("region",)} for name in REGIONS},
        **{name: {"roles": ("agent",)} for name in hosts},
        "east": {"roles": ("agent",), "family": True},
        "chief": {"roles": ("operator", "agent")},
    }


class Elsewhere:
    """A world whose regions and hosts are attached."""

    def __init__(self, world):
        self.world, self.door = world, secured_endpoint(world)

    def attach(self, process, door, *words, keys=""):
        return Run(
            self.world.folder, "attach", self.world.path, "--process", process, "--connect", door,
            "--regions", 2, "--world", self.world.name, "--keys", f"keys/{keys or process}.pem",
            *words,
        )  # fmt: skip

    def region(self, number, listen="tls/localhost:0"):
        words = "--link", "tls/localhost:0", "--listen", listen
        return self.attach(REGIONS[number], self.door, *words)

    def advances(self):
        eventually(self.world.members, self.world.text)
        at = self.world.frame
        eventually(lambda: self.world.members() and self.world.frame > at + 5, self.world.text)

    def shows(self, host, state):
        def shown():
            members = self.world.members()
            return members and members.get(host, {"state": "gone"})["state"] == state

        eventually(shown, f"{host} is {state}\n{self.world.text}")


def listens(region):
    def line():
        return next((each for each in region.text.splitlines() if "listens at" in each), "")

    return eventually(line, region.text).partition("listens at ")[2].partition(";")[0]


def same_as_one_coordinator(folder, path, ended):
    words = "--in-process", "--rate", 0, "--frames", ended["frames"], "--record", "one.mcap"
    single = summary(here(folder, "run", path, *words, "--regions", 0, "--json"))
    assert ended["digest"] == single["digest"]
    with Record(folder / "run.mcap") as several, Record(folder / "one.mcap") as one:
        pairs = zip(several.frames(), one.frames(), strict=True)
        assert all(first.digest == second.digest for first, second in pairs)


WORDS = "--rate", 30, "--coordinator-only", "--record", "run.mcap", "--json", "--frames", 0


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_awaited_hosts_and_their_regions_may_die(tmp_path, end):
    """A host that leaves is awaited, too: without it, its agents would not evolve."""
    hosts = [f"{name}.walkers" for name in REGIONS]
    path = keyed_world(tmp_path, certificates(*hosts), members=MEMBERS + HOSTS)[0]
    with World(path, *WORDS) as world:
        there = Elsewhere(world)
        with there.region(0) as first, there.region(1) as second:
            doors = listens(first), listens(second)
            with (
                there.attach(hosts[0], doors[0]) as lost,
                there.attach(hosts[1], doors[1]) as host,
            ):
                there.advances()
                lost.process.send_signal(end)
                there.shows(hosts[0], "lost")
                with there.attach(hosts[0], doors[0]):
                    there.advances()
                    second.kill()
                    world.says(REGIONS[1], "is gone")
                    with there.region(1, doors[1]) as second:
                        there.advances()
                        assert host.process.poll() is None, host.text
                        done = here(tmp_path, "restart", world.name, hosts[1])
                        assert "runs on another machine: restart it there" in done.stderr
                        done = here(tmp_path, "drain", world.name, hosts[1])
                        assert "its agents move to others" in done.stderr
                        here(tmp_path, "stop", world.name)
                        ended = world.summary()
    same_as_one_coordinator(tmp_path, path, ended)


def test_hosts_divide_the_agents_of_their_region(tmp_path):
    """As an autoscaler does: two join, one goes, and the other has all of the region's walkers."""
    string = " · ".join(f"AWalker#w{number}" for number in range(40))
    path = keyed_world(tmp_path, certificates(), members=MEMBERS, string=string)[0]
    with World(path, *WORDS, "--regions", 2) as world:
        there, names = Elsewhere(world), ("region-0.east-1", "region-0.east-2")

        def agents():
            members = world.members()
            return [members[name]["figures"].get("agents", 0) for name in names if name in members]

        with there.region(0) as first, there.region(1):
            door = listens(first)
            with (
                there.attach("walkers", door, "--name", "east-1", keys="east") as left,
                there.attach("walkers", door, "--name", "east-2", keys="east"),
            ):
                eventually(lambda: len(agents()) == 2 and all(agents()), world.text)
                both = sum(eventually(lambda: sorted(agents()), world.text))
                left.kill(signal.SIGTERM)
                eventually(lambda: len(agents()) == 1 and agents()[0] > 0.9 * both, world.text)
                there.advances()
                here(tmp_path, "stop", world.name)
                ended = world.summary()
    same_as_one_coordinator(tmp_path, path, ended)


def test_further_hosts_come_and_go(tmp_path):
    """Without `hosts` in the world file, the region evolves agents whenever nobody else does."""
    path = keyed_world(tmp_path, certificates(), members=MEMBERS)[0]
    with World(path, *WORDS, "--regions", 2) as world:
        there = Elsewhere(world)
        with there.region(0) as first, there.region(1) as second:
            door, _ = listens(first), listens(second)
            there.advances()
            for name, end in (("east-1", signal.SIGTERM), ("east-2", signal.SIGKILL)):
                with there.attach("walkers", door, "--name", name, keys="east") as host:
                    there.shows(f"region-0.{name}", "present")
                    there.advances()
                    host.process.send_signal(end)
                    there.shows(f"region-0.{name}", "gone")
                    there.advances()
            here(tmp_path, "stop", world.name)
            ended = world.summary()
    same_as_one_coordinator(tmp_path, path, ended)


@pytest.mark.parametrize(("process", "words", "reason"), [
    ("walkers", ("--name", "walkers"), "the region itself runs a member of this name"),
    ("steps", ("--name", "east-3"), "its certificate is for agent, not for generator"),
])  # fmt: skip
def test_a_region_takes_no_other_member(tmp_path, process, words, reason):
    issue = certificates("walkers")
    path = keyed_world(tmp_path, issue, members=MEMBERS)[0]
    with World(path, *WORDS, "--regions", 2) as world:
        there = Elsewhere(world)
        with there.region(0) as first, there.region(1):
            door = listens(first)
            keys = "walkers" if process == "walkers" else "east"
            with there.attach(process, door, *words, keys=keys) as other:
                assert other.ends() == 2, other.text
                assert reason in other.text
            there.advances()
            stop = "stop", world.name, "--connect", door, "--keys", "keys/chief.pem"
            assert here(tmp_path, *stop).returncode != 0
            there.advances()
