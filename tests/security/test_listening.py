"""Endpoints: a world accepts remote members only with certificates, or with --insecure."""

import errno
import sys
from pathlib import Path

import pytest
from running import MEMBERS, Run, write_world

from minerva_bus.errors import BusError, KeysError, WorldFileError
from minerva_bus.launch.coordinator_process import local_endpoint, security
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.endpoints import check_endpoint, for_others, own_endpoint
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.wire.plain import DEFAULT
from minerva_certificates import AuthorityFolder
from minerva_services.views.page_access import page_url
from minerva_services.web_access import WebAccess
from tests.runtime.yard import Screen
from tests.security.secured import Joined, World, goes_on, keyed_world, present, secured_endpoint

sys.path.append(str(Path(__file__).parents[1] / "runtime"))


def border(path, listen="", **given):
    file = read_world_file(path, Overrides(listen=listen, **given))
    return file.access


@pytest.mark.parametrize(
    ("endpoint", "local"),
    [
        ("tcp/127.0.0.1:0", True),
        ("tcp/127.1.2.3:1", True),
        ("tcp/[::1]:1", True),
        ("tcp/localhost:1", True),
        ("unixsock-stream/a/b", True),
        ("tcp/0.0.0.0:1", False),
        ("tcp/[::]:1", False),
        ("tcp/192.168.1.2:1", False),
        ("tcp/127.0.0.1.example:1", False),
    ],
)
def test_endpoints_that_only_this_machine_reaches(endpoint, local):
    assert check_endpoint(endpoint).local == local


@pytest.mark.parametrize(
    ("listen", "actual", "own", "others"),
    [
        ("tcp/127.0.0.1:0", "tcp/127.0.0.1:5", "tcp/127.0.0.1:5", "tcp/127.0.0.1:5"),
        ("tcp/192.168.1.2:7", "tcp/192.168.1.2:7", "tcp/192.168.1.2:7", "tcp/192.168.1.2:7"),
        ("tcp/0.0.0.0:7", "tcp/0.0.0.0:7", "tcp/127.0.0.1:7", "tcp/0.0.0.0:7"),
        ("tcp/0.0.0.0:0", "tcp/192.168.1.2:5", "tcp/127.0.0.1:5", "tcp/0.0.0.0:5"),
        ("tcp/[::]:7", "tcp/[::]:7", "tcp/[::1]:7", "tcp/[::]:7"),
        ("tcp/[::]:0", "tcp/[fe80::1]:5", "tcp/[::1]:5", "tcp/[::]:5"),
    ],
)
def test_members_of_this_machine_use_loopback(listen, actual, own, others, monkeypatch):
    monkeypatch.setattr("minerva_bus.runtime.endpoints.socket.socket.bind", lambda *_: None)
    assert own_endpoint(listen, actual) == own
    assert for_others(listen, own) == others


def test_members_use_ipv4_where_ipv6_is_off(monkeypatch):
    def bind(probe, place):
        raise OSError(errno.EADDRNOTAVAIL, "Cannot assign requested address")

    monkeypatch.setattr("minerva_bus.runtime.endpoints.socket.socket.bind", bind)
    assert own_endpoint("tcp/[::]:7", "tcp/[::]:7") == "tcp/127.0.0.1:7"
    # A page's address is for a browser of this machine.
    assert page_url(WebAccess("::", 8080, "t")) == "http://127.0.0.1:8080/?token=t"


@pytest.mark.parametrize("kind", ["tcp", "udp", "ws"])
def test_an_open_door_is_refused_with_what_to_do_unless_one_insists(tmp_path, kind):
    path, listen = write_world(tmp_path), f"{kind}/0.0.0.0:7447"
    with pytest.raises(BusError, match=r"create keys .*tls/0\.0\.0\.0:7447 .*or insist"):
        border(path, listen)
    assert border(path, listen, insecure=True).keys is None


def test_a_secured_door_needs_keys_and_keys_a_secured_door(tmp_path):
    path = write_world(tmp_path)
    with pytest.raises(BusError, match=r"tls/0\.0\.0\.0:7447 needs keys: minerva keys init"):
        border(path, "tls/0.0.0.0:7447")
    with pytest.raises(BusError, match="listen at tls/"):
        border(path, keys="keys")
    assert border(path, "tls/0.0.0.0:7447", keys="keys").keys == Path("keys")


def test_the_world_file_can_set_it_too(tmp_path):
    own = 'listen = "tls/0.0.0.0:0"\nkeys = "keys"\nconnect = ["tls/a.example:1"]\n'
    path = write_world(tmp_path, bus=own + "[limits]\nmessages = 7\nbytes = 9000\n")
    listening = border(path)
    assert (listening.keys, listening.routers) == (tmp_path / "keys", ("tls/a.example:1",))
    assert (listening.limits.messages, listening.limits.bytes) == (7, 9000)
    assert listening.limits.message_bytes == DEFAULT.message_bytes
    with pytest.raises(KeysError, match="create one with minerva keys init"):
        security(listening, "w")


def test_a_router_elsewhere_is_joined_by_a_secured_link_only(tmp_path):
    path = write_world(tmp_path)
    with pytest.raises(BusError, match=r"tcp/a\.example:1 .*or insist with --insecure"):
        border(path, connect=("tcp/a.example:1",))
    with pytest.raises(BusError, match="needs keys"):
        border(path, connect=("tls/a.example:1",))
    assert border(path, connect=("tcp/a.example:1",), insecure=True).routers
    assert border(path, connect=("tls/a.example:1",), keys="keys").keys


@pytest.mark.parametrize("wrong", ["messages = 0", "bytes = 1", "message_bytes = 'x'", "rate = 5"])
def test_limits_that_cannot_be(tmp_path, wrong):
    with pytest.raises(WorldFileError, match="limits"):
        border(write_world(tmp_path, bus=f"[limits]\n{wrong}\n"))


def test_the_coordinator_needs_the_list_of_revoked_names(tmp_path, monkeypatch):
    own = 'listen = "tls/0.0.0.0:0"\nkeys = "keys"\n'
    path, keys = write_world(tmp_path, bus=own), AuthorityFolder(tmp_path / "keys")
    keys.init()
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(runtime))
    assert security(border(path), "w").rights()["coordinator"].roles == {"coordinator"}
    (keys.folder / "crl.pem").unlink()
    with pytest.raises(KeysError, match="without it, revoked members could join"):
        security(border(path), "w").rights()


def test_the_socket_of_this_machine_is_its_owner_s_alone(tmp_path, monkeypatch):
    place = tmp_path / "r"
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(place))
    with pytest.raises(BusError, match=r"cannot use .* for running worlds"):
        local_endpoint("w")
    place.mkdir(mode=0o700)
    assert local_endpoint("w") == f"unixsock-stream/{place}/w.sock"
    with pytest.raises(BusError, match="too long for a socket"):
        local_endpoint("w" * 64 + "/" + "x" * 64)
    place.chmod(0o755)
    with pytest.raises(BusError, match="is accessible to other users"):
        local_endpoint("w")


@pytest.mark.parametrize("listen", ["tcp/[::]:0", "tcp/0.0.0.0:0"])
def test_own_members_find_a_world_that_listens_everywhere(listen, tmp_path):
    path = write_world(tmp_path, MEMBERS, frames=3)
    words = ("run", path, "--listen", listen, "--insecure")
    with Run(tmp_path, *words) as run:
        assert run.ends() == 0
        assert "bus at tcp/127.0.0.1:" in run.text or "bus at tcp/[::1]:" in run.text


def test_a_member_rejoins_with_its_certificate(tmp_path):
    path, keys = keyed_world(tmp_path, {"look": {"roles": ("view",)}}, frames=0, rate=20)
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
