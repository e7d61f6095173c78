"""Several networks: a client, a router in between, and the world behind it."""

import json
import sys
from pathlib import Path

import pytest
import zenoh

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
import yard
from running import Run, here
from secured import Client, Joined, World, eventually, goes_on, keyed_world, present

from minerva_bus.errors import BusError
from minerva_bus.runtime.session import listening_at, open_client

LISTEN = "tls/127.0.0.1:0"
ISSUED = {
    "middle": {"roles": ("router",)},
    "ann": {"roles": ("operator",)},
    "sensor": {"roles": ("generator",)},
    "screen": {"roles": ("view",)},
    "spy": {"roles": ("view",)},
    "hosts": {"roles": ("agent",), "family": True},
}


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    """A world connected to a router, the router's endpoint, and the keys."""
    folder = tmp_path_factory.mktemp("chain")
    path, keys = keyed_world(folder, ISSUED, frames=0, rate=20)
    printed = here(folder, "keys", "router", "middle", path.stem, "--listen", LISTEN)
    config = zenoh.Config.from_json5(printed.stdout)
    config.insert_json5("adminspace/enabled", "true")  # It provides the actual port.
    with zenoh.open(config) as router:
        place = listening_at(router, LISTEN)
        with World(path, "--connect", place) as world:
            world.runs("steps", "walkers")
            yield world, place, keys


def test_members_and_people_connect_through_a_router(chain):
    world, place, keys = chain
    noise, screen = keys.credentials("sensor"), keys.credentials("screen")
    with (
        Joined(world, place, noise, yard.Noise()),
        Joined(world, place, screen, yard.Screen()) as eye,
    ):
        present(world, "sensor")
        present(world, "screen")
        eventually(lambda: eye.member.member.service.pictures > 3, "views come")
        with Client(place, world.name, keys.credentials("ann")) as ann:
            ann.operator.pause()
            assert ann.operator.status().paused
            ann.operator.resume()
        goes_on(world)


def test_the_router_holds_the_world_s_rules(chain):
    world, place, keys = chain
    base, heard = f"minerva/{world.name}", []
    with (
        open_client("inside", world.endpoint()) as inside,
        open_client("spy", place, own=keys.credentials("spy")) as spy,
    ):
        kept = inside.declare_subscriber(
            f"{base}/**", lambda sample: heard.append(str(sample.key_expr))
            if sample.payload.to_bytes() == b"evil" else None
        )  # fmt: skip

        def says(key):
            spy.put(f"{base}/{key}", b"evil")

        def arrived():
            for key in ("from/steps", "tick", "topic/sight/spy", "from/spy"):
                says(key)
            return heard

        eventually(arrived, "what it may say")
        assert set(heard) == {f"{base}/from/spy"}
        kept.undeclare()
        with pytest.raises(BusError, match="spy may not send commands"):
            Client(place, world.name, keys.credentials("spy")).ask("stop")
    goes_on(world)


def test_a_family_joins_through_a_router_until_it_is_revoked(chain):
    """Their links end at the router and are not closed."""
    world, place, keys = chain
    names = ("hosts-a", "hosts-b")
    first, second = (
        Joined(world, place, keys.credentials(name), agents=(yard.Walker,)) for name in names
    )
    with first, second:
        for name in names:
            present(world, name)
        keys.revoke("hosts")
        for member in (first, second):
            assert "its certificate was revoked" in member.ends()
        assert {world.members()[name]["state"] for name in names} == {"left"}
    goes_on(world)


def test_commands_connect_through_it_too(chain):
    world, place, _ = chain
    who = ("--connect", place, "--world", world.name, "--keys")
    with Run(world.folder, "attach", "yard:Noise", *who, "keys", "--name", "sensor") as attached:
        present(world, "sensor")
        done = here(world.folder, "list", "--json", *who, "keys/ann.pem")
        states = {row["member"]: row["state"] for row in json.loads(done.stdout)["members"]}
        assert states["sensor"] == "present"
        seen = here(world.folder, "echo", "eShow", "--count", "1", *who, "keys/screen.pem")
        assert "TAt" in seen.stdout, seen.stderr
        seen = here(world.folder, "echo", "eStep", "--count", "1", *who, "keys/ann.pem")
        assert "eStep" in seen.stdout, seen.stderr
        unnamed = here(world.folder, "attach", "yard:Noise", *who, "keys/sensor.pem")
        assert "there is a member 'sensor' in the world already" in unnamed.stderr
        wrong = here(world.folder, "attach", "yard:Noise", *who, "keys/ann.pem", "--name", "x")
        assert "attach with --name ann" in wrong.stderr
        refused = here(world.folder, "stop", world.name, *who[:2], "--keys", "keys/spy.pem")
        assert "spy may not send commands" in refused.stderr
        stopped = here(world.folder, "stop", world.name, *who[:2], "--keys", "keys/ann.pem")
        assert stopped.returncode == 0, stopped.stderr
        assert attached.ends() == 0, attached.text
    assert world.ends() == 0
