"""Two networks with a router between them, as in the page on certificates, and a slow, lossy line."""

import sys
from pathlib import Path
from random import Random

import pytest
from hosts import Network, needs_hosts
from spread import PORT, THERE, Spread

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
from running import Run, World, eventually, here, summary, write_world

from minerva_conformance.proxy import Proxy, slow_line

ROUTER = Path(__file__).with_name("zenoh_router.py")


class Middle:
    """A host on both networks, with a Zenoh router."""

    def __init__(self, network):
        self.host = network.host("middle", 1, 2)
        self.router = None

    def begins(self, spread):
        """Start the router with its own keys and the world's rules."""
        if self.router is None:
            spread.send_keys("middle", self.host)
        words = ("router", "middle", "spread", "--listen", f"tls/0.0.0.0:{PORT}")
        printed = here(spread.hub.folder, "keys", *words)
        assert printed.returncode == 0, printed.stderr
        text = printed.stdout.replace(str(spread.hub.folder), str(self.host.folder))
        (self.host.folder / "middle.json5").write_text(text)
        self.router = self.host.program(sys.executable, ROUTER, "middle.json5")

    def ends(self):
        if self.router is not None:
            self.router.kill()
            self.router.wait()
            self.router.stdout.close()


@pytest.fixture(scope="module")
def middle(tmp_path_factory):
    """The router's host, and a world on one network with its members on the other."""
    with Network(tmp_path_factory.mktemp("two")) as network:
        hub, middle = network.host("hub", 1), Middle(network)
        far = {name: network.host(name, 2) for name in THERE if name != "west"}
        more = {"middle": {"roles": ("router",), "hosts": ("middle",)}}
        middle.spread = Spread(hub, far, door="middle", more=more)
        try:
            middle.begins(middle.spread)
            middle.spread.begin("--connect", f"tls/middle:{PORT}")
            yield middle
        finally:
            middle.spread.close()
            middle.ends()


@needs_hosts
def test_members_of_another_network_connect_through_the_router(middle):
    middle.spread.goes_on()
    way = middle.spread.hosts["east"].does("ip", "route", "get", middle.spread.hub.address)
    assert "unreachable" in way.stderr


@needs_hosts
def test_a_network_that_is_away_for_a_while(middle):
    with middle.spread.missing("east"), middle.spread.missing("water"):
        middle.host.link("down", 2)
    middle.host.link("up", 2)
    middle.spread.goes_on()


@needs_hosts
def test_a_router_that_restarts(middle):
    with middle.spread.missing("east"):
        middle.ends()
    middle.begins(middle.spread)
    middle.spread.goes_on()


@needs_hosts
def test_the_router_away_from_the_world_for_a_while(middle):
    with middle.spread.missing("east"):
        middle.host.link("down", 1)
    middle.host.link("up", 1)
    middle.spread.goes_on()


@needs_hosts
def test_every_frame_is_as_if_there_had_been_one_network(middle):
    assert middle.spread.is_as_if_nothing_had_happened()


MEMBERS = """
[process.steps]
service = "yard:Steps"

[process.walkers]
agents = "yard:Walker"
elsewhere = true
"""


def test_a_slow_and_lossy_line_that_is_cut(tmp_path):
    """50 ms in each direction, one chunk in a hundred lost, and one broken connection."""
    path = write_world(tmp_path, MEMBERS, frames=40)
    alone = path.with_name("alone.toml")
    alone.write_text(path.read_text().replace("elsewhere = true\n", ""))
    undisturbed = summary(
        here(tmp_path, "run", alone, "--name", path.stem, "--in-process", "--json")
    )
    with World(path, "--json") as world:
        port = int(world.endpoint().rpartition(":")[2])
        with Proxy(port, slow_line(Random(1), 0.05, 0.01)) as proxy:
            way = ("--connect", f"tcp/127.0.0.1:{proxy.port}", "--world", path.stem)
            with Run(tmp_path, "attach", path, "--process", "walkers", *way) as walkers:
                world.runs("walkers")
                assert proxy.cut() >= 1
                world.says("walkers │ is gone; the world waits for it")
                ended = world.summary()
                assert walkers.ends() == 0
    assert (ended["frames"], ended["digest"]) == (40, undisturbed["digest"])
    eventually(lambda: proxy.cut() == 0, "no connection is left")
