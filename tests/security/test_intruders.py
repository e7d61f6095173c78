"""Attacks on a real world by real sessions that request more than they are allowed.

All attempts are rejected, and no frame is affected. What the coordinator itself rejects is reported
with a name and a reason, and counted.
"""

import socket
import ssl
import sys
from datetime import timedelta
from pathlib import Path

import pytest
import zenoh

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
import yard
from running import below, ends_as_alone, here, minerva, put
from secured import (
    AuthorityFolder,
    Client,
    Joined,
    Wanted,
    World,
    eventually,
    goes_on,
    keyed_world,
    present,
    refused,
    secured_endpoint,
    status,
    stolen,
)

from minerva_bus.errors import BusError, KeysError
from minerva_bus.frame import messages as m
from minerva_bus.runtime.session import open_client
from minerva_certificates.key_folder import now
from tests.patience import patience

STRING = " · ".join(f"AWalker#{name}<x={x}>" for x, name in enumerate("abcdefgh"))
LIMITS = "[limits]\nmessages = 500\nmessage_bytes = 4194304\n"
GENERATOR = {"roles": ("generator",)}
ISSUED = {
    "ann": {"roles": ("operator",)},
    "watcher": {"roles": ("view",)},
    "sensor": {**GENERATOR, "topics": ("battery",)},
    "flooder": GENERATOR,
    "giant": GENERATOR,
    "quiet": {"roles": ("generator",), "events": ("eNoise",), "topics": ("battery",)},
    "host": {"roles": ("agent",)},
    "narrow": {"roles": ("agent",), "kinds": ("AFragile",)},
    "revoked": GENERATOR,
    "fallen": GENERATOR,
    "late": GENERATOR,
}


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sec")
    path, keys = keyed_world(folder, ISSUED, LIMITS, string=STRING, frames=0, rate=20)
    keys.revoke("revoked")
    past = AuthorityFolder(folder / "keys", now() - timedelta(days=10))
    past.issue("expired", Wanted(("generator",), days=1))
    AuthorityFolder(folder / "foreign").init()
    AuthorityFolder(folder / "foreign").issue("sensor", Wanted(("generator",)))
    with World(path) as world:
        world.runs("steps", "walkers")
        yield world


@pytest.fixture(scope="module")
def inside(world):
    """A session on this machine, which may receive everything."""
    with open_client("inside", world.endpoint()) as session:
        yield session


def listen(session, key):
    heard = []
    kept = session.declare_subscriber(
        key, lambda sample: heard.append((str(sample.key_expr), sample.payload.to_bytes())),
        allowed_origin=zenoh.Locality.REMOTE,
    )  # fmt: skip
    return heard, kept


# --- clients without a valid certificate ---


def knock(door, folder=None, name="", trust=None):
    """Perform a TLS handshake that accepts any server certificate, then read one byte."""
    host, _, port = door.partition("/")[2].rpartition(":")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    if folder is not None:
        context.load_cert_chain(folder / f"{name}.pem", folder / f"{name}.key")
    with (
        socket.create_connection((host, int(port)), 10) as raw,
        context.wrap_socket(raw) as link,
    ):
        return link.recv(1)


@pytest.mark.parametrize(
    ("folder", "name", "alert"),
    [
        (None, "", "CERTIFICATE_REQUIRED"),
        ("keys", "expired", "CERTIFICATE_EXPIRED"),
        ("foreign", "sensor", "DECRYPT_ERROR|UNKNOWN_CA"),
    ],
)
def test_no_link_without_a_valid_certificate(world, door, folder, name, alert):
    with pytest.raises(ssl.SSLError) as error:
        knock(door, folder and world.folder / folder, name)
    assert error.value.reason.split("ALERT_")[1] in alert.split("|")
    goes_on(world)


def test_plain_tcp_at_the_secured_door_is_no_way_in(world, door):
    with pytest.raises(BusError, match="speaks TLS: connect to tls/"):
        open_client("plain", door.replace("tls/", "tcp/"), 1.0)
    goes_on(world)


def test_a_revoked_member_is_cut_off_and_receives_nothing(world, door, keys):
    with pytest.raises(KeysError, match="the certificate of revoked is revoked"):
        keys.credentials("revoked")
    with open_client("revoked", door, own=stolen(keys.folder, "revoked")) as session:
        heard, _kept = listen(session, f"minerva/{world.name}/**")
        world.says("revoked │ its certificate was revoked; its link", "is cut")
        goes_on(world)
    assert heard == []
    assert refused(world, "revoked") > 0
    open_files = [len(list(Path(f"/proc/{pid}/fd").iterdir())) for pid in below(world.process.pid)]
    assert max(open_files) < 150


def test_revoking_removes_a_running_member(world, door, keys):
    own = keys.credentials("fallen")
    with (
        Joined(world, door, own, yard.Noise()) as joined,
        open_client("fallen", door, own=own),
    ):
        present(world, "fallen")
        keys.revoke("fallen")
        world.says("fallen │ broke the protocol: its certificate was revoked")
        assert joined.ends() == "the world does not take fallen: its certificate was revoked"
        world.says("fallen │ its certificate was revoked; its link", "is cut")
        assert world.members()["fallen"]["state"] == "left"
        goes_on(world)
        assert refused(world, "fallen") > 0


def test_a_member_whose_certificate_is_revoked_is_informed_when_it_joins(world, door, keys):
    own = keys.credentials("late")
    keys.revoke("late")
    with Joined(world, door, own, yard.Noise()) as joined:
        assert "revoked" in joined.ends()
    # The world has read the revocation list by now, so this member's links are cut.
    with Joined(world, door, own, yard.Noise()) as joined:
        assert "late" in joined.ends()
        assert "revoked" in str(joined.result)
        assert not any("busy" in line for line in joined.told)
    world.says("late │ its certificate was revoked; its link")
    assert "cannot be cut" not in world.text
    goes_on(world)


def test_a_link_that_cannot_be_cut_receives_the_reason(tmp_path):
    path, keys = keyed_world(tmp_path, {"late": GENERATOR}, listen="quic/127.0.0.1:0", frames=0)
    with World(path) as world:
        world.runs("steps")
        door, own = secured_endpoint(world), keys.credentials("late")
        keys.revoke("late")
        for _ in range(2):
            with Joined(world, door, own, yard.Noise()) as joined:
                assert "its certificate was revoked" in joined.ends()
        world.says("late │ its certificate was revoked; its link", "cannot be cut")


def test_a_certificate_issued_later_is_valid_after_the_next_start(world, door, keys):
    keys.issue("newcomer", Wanted(("operator",)))
    with (
        pytest.raises(BusError, match="it rejects newcomer, whose certificate"),
        Client(door, world.name, keys.credentials("newcomer")) as asked,
    ):
        asked.operator.status()
    world.says("newcomer │ connected from tls/", "issued after the world began")


def test_a_command_with_a_rejected_certificate_reports_it_and_exits(world, door, keys):
    keys.issue("later", Wanted(("operator",)))
    asked = minerva(world.folder, "list", "--connect", door, "--keys", keys.folder / "later.pem")
    assert asked.returncode == 2
    assert "it rejects later, whose certificate" in asked.stderr


# --- clients with a certificate for something else ---


def test_a_member_speaks_on_its_own_keys_only(world, door, keys, inside):
    base, evil = f"minerva/{world.name}", b"\x00evil"
    heard, kept = listen(inside, f"{base}/**")
    foreign = [
        "all", "tick", "evolve", "to/steps", "view/eShow", "record", "from/steps",
        "from/coordinator", "topic/sight/water", "topic/sight/sensor", "topic/*/sensor",
        "control", "ask/sensor", "epoch/9",
    ]  # fmt: skip
    with open_client("sensor", door, own=keys.credentials("sensor")) as session:
        tokens = [
            session.liveliness().declare_token(f"{base}/{key}")
            for key in ("alive/coordinator", "alive/steps", "epoch/99", "alive/somebody")
        ]
        for key in foreign:
            put(session, f"{base}/{key}", evil)
        put(session, f"{base}/topic/battery/sensor", evil)
        put(session, f"{base}/from/sensor", evil)
        eventually(lambda: len([k for k, data in heard if data == evil]) >= 2, "its own arrive")
        there = [
            str(reply.ok.key_expr) for reply in inside.liveliness().get(f"{base}/**") if reply.ok
        ]
        del tokens
    keys_of_evil = sorted(key for key, data in heard if data == evil)
    assert keys_of_evil == [f"{base}/from/sensor", f"{base}/topic/battery/sensor"]
    assert f"{base}/alive/somebody" not in there
    assert f"{base}/epoch/99" not in there
    assert "somebody" not in world.members()
    kept.undeclare()
    goes_on(world)


def test_a_member_confined_to_topics_publishes_on_these_only(world, door, keys, inside):
    base = f"minerva/{world.name}/topic"
    heard, kept = listen(inside, f"{base}/**")
    with open_client("quiet", door, own=keys.credentials("quiet")) as session:
        for topic in ("scan", "battery"):
            put(session, f"{base}/{topic}/quiet", b"evil")
        eventually(lambda: heard, "what it may say arrives")
    assert [key for key, _ in heard] == [f"{base}/battery/quiet"]
    kept.undeclare()


def test_a_subscription_to_everything_receives_nothing(world, door, keys):
    """It can receive its own keys: another session with the same certificate does."""
    own = keys.credentials("sensor")
    with open_client("sensor", door, own=own) as spy, open_client("sensor", door, own=own) as good:
        ticks, kept = listen(good, f"minerva/{world.name}/tick")
        spied = [listen(spy, key) for key in ("**", "minerva/**", f"minerva/{world.name}/evolve",
                 f"minerva/{world.name}/from/*", f"minerva/{world.name}/to/steps",
                 f"minerva/{world.name}/record", f"minerva/{world.name}/view/*")]  # fmt: skip
        eventually(lambda: len(ticks) > 5, "ticks come")
        assert [heard for heard, _ in spied if heard] == []
        assert not [reply for reply in spy.get("@/**") if reply.ok and str(reply.ok.key_expr) != ""
                    and "/router" in str(reply.ok.key_expr)]  # fmt: skip
        kept.undeclare()


@pytest.mark.parametrize(
    ("name", "service", "agents", "reason"),
    [
        ("watcher", yard.Noise(), (), "its certificate is for view, not for generator"),
        ("sensor", yard.Screen(), (), "its certificate is for generator, not for view"),
        ("sensor", None, (yard.Walker,), "its certificate is for generator, not for agent"),
        ("watcher", yard.Water(), (), "its certificate is for view, not for generator"),
        ("quiet", yard.Steps(), (), "its certificate is for the events eNoise, not for eStep"),
        ("narrow", None, (yard.Walker,), "is for the agents AFragile, not for AWalker"),
    ],
)
def test_a_hello_beyond_the_certificate_is_rejected(
    world, door, keys, name, service, agents, reason
):
    before = refused(world, name)
    with Joined(world, door, keys.credentials(name), service, agents) as joined:
        assert reason in joined.ends()
    world.says(f"{name} │", reason)
    assert refused(world, name) > before
    assert world.members()[name]["state"] == "left"


def test_output_of_members_cannot_control_a_terminal(world, door, keys):
    with Joined(world, door, keys.credentials("sensor"), yard.Noise()) as joined:
        present(world, "sensor")
        joined.member.link.send(m.MemberMetrics("sensor", {"note": "\x1b[2Jhi"}))
        for n in range(20):
            joined.member.link.send(m.Failed("sensor", n, "\x1b]0;title\x07\ntwo\u202e", "three"))
        world.says("sensor │ failed in frame 0: ?]0;title?")
        world.says("sensor │ two?")
        listed = eventually(
            lambda: (
                "?[2Jhi" in (out := here(world.folder, "list", "--world", world.name).stdout)
                and out
            ),
            "it is listed",
        )
    logged = here(world.folder, "logs", "--world", world.name).stdout
    assert not {"\x1b", "\x07", "\u202e"} & {*world.text, *listed, *logged}
    assert world.text.count("sensor │ failed") == 1


def test_a_flood_is_dammed_and_its_source_named_once(world, door, keys):
    with Joined(world, door, keys.credentials("flooder"), yard.Noise()) as joined:
        present(world, "flooder")
        message = m.Emitted("flooder", (yard.eNoise(),))
        for _ in range(10_000):
            joined.member.link.send(message)
        world.says("flooder │ sends more than 500 messages", "the rest is dropped")
        eventually(lambda: refused(world, "flooder") > 1000, "what is not heard is counted")
        goes_on(world)
    assert world.text.count("flooder │ sends more") == 1


def test_oversized_input_is_rejected_before_it_is_read(world, door, keys):
    with Joined(world, door, keys.credentials("giant"), yard.Noise()) as joined:
        present(world, "giant")
        message = joined.member.link.stamp + bytes(50 << 20)
        with open_client("giant", door, own=keys.credentials("giant")) as session:
            for _ in range(9):  # A link that is too slow for this size is closed and reconnects.
                put(session, f"minerva/{world.name}/from/giant", message)
                joined.over.wait(patience(2))
                if joined.over.is_set():
                    break
            assert "over 4194304" in joined.ends()
    world.says("giant │ broke the protocol", "bytes at once, over 4194304")
    goes_on(world)


# --- commands ---


def test_orders_are_an_operator_s(world, door, keys):
    with Client(door, world.name, keys.credentials("ann")) as ann:
        ann.operator.pause()
        assert status(world).paused
        ann.operator.resume()
        assert ann.ask("scene")["scene"]
    with Client(door, "", keys.credentials("watcher")) as watcher:
        assert watcher.world == world.name
        assert watcher.ask("scene")["scene"]
        for question in ("pause", "stop", "restart", "step", "no such thing"):
            with pytest.raises(BusError, match="watcher may not send commands"):
                watcher.ask(question, member="steps")
    with Client(door, world.name, keys.credentials("sensor")) as sensor:
        assert sensor.operator.status().world == world.name
        with pytest.raises(BusError, match="sensor may not read the world"):
            sensor.ask("scene")
    eventually(lambda: refused(world, "watcher") >= 5, "each question is counted")
    assert not status(world).paused


@pytest.mark.parametrize("key", ["control", "control/ann", "control/watcher", "ask/ann"])
def test_a_query_in_another_name_is_rejected(world, door, keys, key):
    with open_client("watcher", door, own=keys.credentials("watcher")) as session:
        for name in (world.name, "*"):
            answers = session.get(f"minerva/{name}/{key}", payload=b"\x81\xa3ask\xa6status",
                                  timeout=patience(5))  # fmt: skip
            assert [answer.ok for answer in answers] == []


# --- the string afterwards ---


def test_the_string_contains_none_of_it(world):
    ends_as_alone(world)
    assert not list((world.folder / "runtime").glob("*.sock"))
