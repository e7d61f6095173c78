"""The successor of a killed coordinator listens at the same endpoint."""

from tests.runtime.yard import Screen
from tests.security.secured import (
    Joined,
    World,
    goes_on,
    keyed_world,
    present,
    secured_endpoint,
)


def test_a_member_rejoins_with_its_certificate(tmp_path):
    path, keys = keyed_world(tmp_path, {"look": {"roles": ("view",)}}, frames=0, rate=50)
    with World(path) as world:
        endpoint = secured_endpoint(world)
        world.runs("steps", "walkers")
        with Joined(world, endpoint, keys.credentials("look"), Screen()) as guest:
            present(world, "look")
            world.kill_coordinator()
            present(world, "look")
            goes_on(world)
            assert guest.result is None
        doors = [line for line in world.lines if "listens at tls/" in line]
        assert len(doors) == 2
        assert len(set(doors)) == 1
