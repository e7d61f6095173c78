"""Unreachable endpoints are reported at once, with a remedy."""

import socket
import sys
from datetime import timedelta
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
from running import here
from secured import stolen

from minerva_bus.errors import BusError
from minerva_bus.runtime.session import Secured, listening_at, open_client, open_hub
from minerva_bus.security.access import access_control
from minerva_bus.wire.keys import Keys as WorldKeys
from minerva_certificates import AuthorityFolder, Wanted
from minerva_certificates.key_folder import now

GENERATOR = Wanted(("generator",))
ANYWHERE = "tls/127.0.0.1:0"


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    keys = AuthorityFolder(tmp_path_factory.mktemp("u") / "keys")
    keys.init()
    keys.issue("sensor", GENERATOR)
    AuthorityFolder(keys.folder, now() - timedelta(days=9)).issue(
        "old", Wanted(("generator",), days=1)
    )
    foreign = AuthorityFolder(keys.folder.parent / "foreign")
    foreign.init()
    foreign.issue("sensor", GENERATOR)
    return keys


@pytest.fixture(scope="module")
def hub(keys):
    """A secured session; returns its endpoint."""
    access = access_control(WorldKeys("w"), keys.rights().values(), [])
    local = f"unixsock-stream/{keys.folder.parent}/hub.sock"
    secured = Secured(keys.credentials("coordinator"), local, access)
    session, _ = open_hub("hub", ANYWHERE, secured=secured)
    with session:
        yield listening_at(session, ANYWHERE)


@pytest.fixture(scope="module")
def silent():
    """A port with a listener that never sends anything."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_a_member_with_a_certificate_joins(hub, keys):
    with open_client("sensor", hub, own=keys.credentials("sensor")) as session:
        assert [str(router) for router in session.info.routers_zid()]


def told(endpoint, own=None, patience=0.5):
    with pytest.raises(BusError) as error:
        open_client("client", endpoint, patience, own=own)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("kind", ["tcp", "tls"])
def test_an_unknown_host_and_a_closed_port(keys, kind):
    own = keys.credentials("sensor")
    assert "there is no host 'nowhere.invalid'; check the name" in told(
        f"{kind}/nowhere.invalid:7447", own
    )
    for host in ("a..b", "a" * 70 + ".example"):
        assert f"there is no host {host!r}; check the name" in told(f"{kind}/{host}:7447", own)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    assert f"nothing listens at port {port} of 127.0.0.1" in told(f"{kind}/127.0.0.1:{port}", own)


def test_an_endpoint_that_never_answers(keys, silent):
    assert "no answer at tcp/127.0.0.1" in told(f"tcp/127.0.0.1:{silent}")
    own = keys.credentials("sensor")
    assert "does not speak TLS; is it a tcp/ endpoint?" in told(f"tls/127.0.0.1:{silent}", own)


def test_the_wrong_way_in(hub, keys):
    assert "requires a certificate; name your keys with --keys FOLDER" in told(hub)
    assert f"speaks TLS: connect to {hub}" in told(hub.replace("tls/", "tcp/"))


def test_a_certificate_that_the_world_does_not_take(hub, keys):
    old = stolen(keys.folder, "old")
    assert "it refuses TLS: your certificate has expired" in told(hub, old)


def test_a_member_rejects_a_world_with_an_untrusted_certificate(hub, keys):
    foreign = AuthorityFolder(keys.folder.parent / "foreign").credentials("sensor")
    assert "its certificate is not of your authority" in told(hub, foreign)
    port = hub.rpartition(":")[2]
    said = told(f"tls/127.0.0.2:{port}", keys.credentials("sensor"))
    if "nothing listens" not in said:  # where 127.0.0.2 is this machine, too
        assert "its certificate is not for '127.0.0.2'" in said


def test_a_port_in_use(hub, keys):
    secured = Secured(keys.credentials("coordinator"), f"unixsock-stream/{keys.folder}/b.sock", {})
    with pytest.raises(BusError, match=r"cannot listen at tls/\S+: Address already in use; choose"):
        open_hub("hub", hub, secured=secured)


@pytest.mark.parametrize("host", ["192.0.2.1", "nowhere.invalid", "a..b"])
def test_an_address_of_another_machine_cannot_be_listened_at(host):
    with pytest.raises(BusError, match=r"cannot listen at \S+: .*; choose an address of this mach"):
        open_hub("hub", f"tcp/{host}:7447")


@pytest.mark.parametrize(
    "words",
    [
        ("list",), ("top", "--json"), ("echo", "eShow"), ("pub", "eStep"), ("stop",), ("logs",),
        ("pause",), ("resume",), ("step",), ("rate", "1"), ("drain", "a"), ("restart", "a"),
        ("attach", "physics", "--name", "sensor"), ("seek", "1"),
    ],
)  # fmt: skip
def test_every_command_that_connects_takes_keys(keys, words):
    done = here(keys.folder.parent, *words, "--connect", "tls/127.0.0.1:1", "--keys", "no")
    assert done.returncode == 2, done.stderr
    assert "no has no authority" in done.stderr


def test_the_keys_of_a_command_lead_to_the_door(keys):
    done = here(keys.folder.parent, "list", "--connect", "tls/nowhere.invalid:1", "--keys",
                "keys/sensor.pem")  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "there is no host 'nowhere.invalid'" in done.stderr


def test_the_keys_of_one_command_are_not_the_next_one_s(keys):
    assert "no has no authority" in here(keys.folder.parent, "list", "--connect",
                                         "tls/127.0.0.1:1", "--keys", "no").stderr  # fmt: skip
    assert "authority" not in here(keys.folder.parent, "list").stderr
    done = here(keys.folder.parent, "list", "--connect", "tcp/127.0.0.1:1")
    assert "authority" not in done.stderr
    assert done.returncode == 2
