"""Messages that Zenoh drops, with --audit: attributed and counted."""

import json
import signal
import sys
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
import yard
from running import ALL_KINDS, Run, here, put, write_world
from secured import (
    Client,
    Joined,
    World,
    eventually,
    goes_on,
    keyed_world,
    present,
    refused,
    status,
)

from minerva_bus.errors import BusError
from minerva_bus.launch.reading import read_world_file
from minerva_bus.runtime.admission_rules import STRANGERS
from minerva_bus.runtime.audit import OPERATIONS, TOO_LARGE, Audit, Denied, read_ruling
from minerva_bus.runtime.session import open_client
from minerva_bus.settings.overrides import Overrides
from minerva_bus.wire.keys import Keys as WorldKeys

# --- log lines as written by Zenoh 1.10.2 ---

kind = WorldKeys("w").kind

HUB, LINK, OTHER = ("d41d517accf7d330a704b69416d33003", "c009b82ebbc5d780730fce7b253a1ef0",
                    "428a44a58acc8f4149e366e7a404e401")  # fmt: skip
TLS, LOCAL = (
    f"Interface(lo)+CertCommonName(sensor)+Transport(Tls)+{LINK}",
    "Transport(UnixsockStream)",
)
TARGET = "zenoh::net::routing::interceptor"
DROPPED = "Msg intercepted!"


def entry(text, target=TARGET, thread=6, link=LINK, level="\x1b[35mTRACE"):
    span = (
        f"\x1b[1mdemux\x1b[0m\x1b[1m{{\x1b[0m\x1b[3mzid\x1b[0m\x1b[2m=\x1b[0m{HUB} "
        f"\x1b[3msrc\x1b[0m\x1b[2m=\x1b[0msouth:0:client/{link[:8]}:4\x1b[1m}}\x1b[0m\x1b[2m:\x1b[0m "
    )
    return (
        f"\x1b[2m2026-11-22T00:22:33.213300Z\x1b[0m {level}\x1b[0m rx-1 ThreadId({thread:02}) "
        f"{span if link else ''}\x1b[2m{target}\x1b[0m\x1b[2m:\x1b[0m {text}\n"
    ).encode()


def ruling(deed, key, *, un="un", on=f" on {TLS}", link=LINK, cached=False, flow="ingress"):
    before = "Using cached result: " if cached else ""
    on = "" if cached else on
    return f"{before}{link}{on} is {un}authorized to {deed} ({flow}) on {key}"


def ruled(*given, thread=6, src=LINK, **more):
    return entry(ruling(*given, **more), f"{TARGET}::access_control", thread, src)


def heard(*lines):
    """Counts for lines that arrive at once and one by one, and the lines that are passed on."""
    chunks = []
    for pieces in ([b"".join(lines)], lines):
        times = Counter()
        audit = Audit(lambda item, times=times: times.update(dict(item.times)), kind)
        chunks.append((times, b"".join([audit.read(piece) for piece in pieces])))
    assert chunks[0] == chunks[1]
    return chunks[0]


def only(denied):
    return Counter({denied: 1})


@pytest.mark.parametrize("deed", sorted(OPERATIONS))
def test_a_forbidden_dropped_message_is_reported_as_denied(deed):
    lines = ruled(deed.decode(), "minerva/w/tick"), entry(DROPPED)
    assert heard(*lines) == (only(Denied("sensor", OPERATIONS[deed], "minerva/w/tick")), b"")


def test_a_reading_that_may_pass_and_is_dropped_is_too_large():
    key = "minerva/w/topic/scan/sensor"
    lines = ruled("Put", key, un=""), entry(DROPPED)
    assert heard(*lines)[0] == only(Denied("sensor", TOO_LARGE, key))


def test_the_identity_of_a_link_is_kept_with_a_remembered_ruling():
    first = ruled("Declare/Undeclare Subscriber", "minerva/w/all")
    again = ruled("Put", "minerva/w/all", cached=True), entry(DROPPED)
    expected = Denied("sensor", "published on", "minerva/w/all")
    assert heard(first, *again, *again)[0] == Counter({expected: 2})
    assert heard(*again)[0] == only(Denied(STRANGERS, "published on", "minerva/w/all"))


@pytest.mark.parametrize(
    "line",
    [
        ruled("Put", "minerva/w/tick"),  # A check in advance: nothing is dropped.
        ruled("Put", "minerva/w/tick") + entry(DROPPED, thread=7),
        ruled("Put", "minerva/w/tick") + entry(DROPPED, link=OTHER),
        ruled("Put", "minerva/w/tick") + ruled("Put", "k", flow="egress") + entry(DROPPED),
        ruled("Liveliness Token", "minerva/w/alive/a", flow="egress", src="") + entry(DROPPED, link=""),
        ruled("Declare Subscriber", f"@/{LINK}/client/config") + entry(DROPPED),
        ruled("Declare Queryable", f"@/{LINK}/**", cached=True) + entry(DROPPED),
        ruled("Declare/Undeclare Subscriber", "minerva/w/tick") + entry(DROPPED),
        ruled("Undeclare Liveliness Token", "minerva/w/tick") + entry(DROPPED),
        ruled("Declare Subscriber", "minerva/w/all", un="") + entry(DROPPED),
        ruled("Query", "@/**", on=f" on {LOCAL}+{LINK}") + entry(DROPPED),
        entry(DROPPED),
        entry("Access control is enabled", f"{TARGET}::access_control", link=""),
        entry("New low-pass filter transport unicast Transport Unicast { zid", f"{TARGET}::low_pass"),
    ],
)  # fmt: skip
def test_a_missing_action_is_not_reported_as_denied(line):
    assert heard(*line.splitlines(keepends=True)) == (Counter(), b"")


def test_it_is_counted_once_and_threads_do_not_mix():
    lines = [
        ruled("Put", "a", thread=6),
        ruled("Put", "b", un="", thread=7),
        entry(DROPPED, thread=6),
        entry(DROPPED, thread=6),
        ruled("Put", "c", thread=6, un=""),
        ruled("Query", "d", thread=7),
        entry(DROPPED, thread=7),
    ]
    expected = [Denied("sensor", "published on", "a"), Denied("sensor", "queried", "d")]
    assert heard(*lines)[0] == Counter(expected)


def test_no_key_can_accuse_another():
    """Zenoh writes line ends unchanged, but the escape character as text."""
    another = TLS.replace("sensor", "ann")
    forged = ruled("Put", "minerva/w/tick", on=f" on {another}") + entry(DROPPED)
    as_text = forged.decode().replace("\x1b", "\\x1b")
    for key in (as_text, "\n" + as_text, as_text.replace("\\x1b", ""), "x) on y is authorized"):
        times, rest = heard(ruled("Put", key), entry(DROPPED))
        assert {denied.sender for denied in times} == {"sensor"}
        assert sum(times.values()) == 1
        assert rest == b""
        assert all("\n" not in denied.key and len(denied.key) <= 200 for denied in times)


def test_the_rest_of_the_log_is_passed_on():
    foreign = b"a line of somebody's own\n"
    other = entry("handshake eof", "zenoh_link_tls::unicast", level="\x1b[33m WARN")
    lines = foreign, other, foreign, ruled("Put", "a\nb\nc"), entry(DROPPED), other
    times, rest = heard(*lines)
    assert rest == foreign + other + foreign + other
    assert sum(times.values()) == 1


PIECES = [
    ruled("Put", "minerva/w/tick")[:-1],
    entry(DROPPED)[:-1],
    entry("x", "zenoh::other")[:-1],
    b"\x1b[2m",
    b"authorized to",
]


@given(st.lists(st.binary(max_size=60) | st.sampled_from(PIECES), min_size=1))
def test_all_lines_are_read_and_only_those_of_zenoh_are_used(lines):
    rulings = []
    data = b"".join([line.replace(b"\n", b"") + b"\n" for line in lines])
    rest = Audit(rulings.append, kind).read(data)
    assert len(rest) <= len(data)
    if TARGET.encode() not in data:
        assert (rest, rulings) == (data, [])
    for item in rulings:
        assert {denied.sender for denied, _ in item.times} == {"sensor"}


@given(st.binary() | st.text().map(str.encode))
def test_any_ruling_is_read(text):
    assert read_ruling(text) is None or b"authorized to" in text


@given(st.text())
def test_every_key_is_reported(key):
    (denied,) = heard(ruled("Put", key), entry(DROPPED))[0]
    assert (denied.sender, denied.operation) == ("sensor", "published on")
    assert denied.key.isprintable()


@pytest.mark.parametrize(
    ("key", "purpose"),
    [("minerva/w/from/a", "from"), ("minerva/w/all", "all"), ("minerva/w/x", ""), ("**", ""),
     ("minerva/wy/all", ""), ("a/minerva/w/all", ""), ("minerva/w", "")],
)  # fmt: skip
def test_purposes_of_keys(key, purpose):
    assert kind(key) == purpose


# --- the switch ---


def test_an_audit_needs_keys(tmp_path):
    path = write_world(tmp_path)
    with pytest.raises(BusError, match=r"an audit is about members with keys: .*--keys"):
        read_world_file(path, Overrides(audit=True))
    path = write_world(tmp_path, bus="audit = true\n")
    with pytest.raises(BusError, match="an audit is about members with keys"):
        read_world_file(path)


def test_an_audit_is_asked_for_in_the_world_file_or_on_the_command_line(tmp_path):
    own = 'listen = "tls/127.0.0.1:0"\nkeys = "keys"\n'
    path = write_world(tmp_path, bus=own)
    assert not read_world_file(path).access.audit
    asked = Overrides(audit=True)
    assert read_world_file(path, asked).access.audit
    assert read_world_file(write_world(tmp_path, bus=f"{own}audit = true\n")).access.audit


# --- a world ---

GENERATOR = {"roles": ("generator",)}
ISSUED = {
    "sensor": GENERATOR,
    "quiet": {"roles": ("generator",), "topics": ("battery",)},
    "giant": GENERATOR,
    "flooder": GENERATOR,
    "forger": GENERATOR,
    "gauges": {**GENERATOR, "family": True},
    "host": {"roles": ("agent",)},
    "eye": {"roles": ("generator", "view")},
    "watcher": {"roles": ("view",)},
    "ann": {"roles": ("view", "operator")},
}
EVIL = b"\x00evil"
LIMITS = "[limits]\nmessage_bytes = 65536\n"


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("aud")
    path, _ = keyed_world(folder, ISSUED, f"audit = true\n{LIMITS}", ALL_KINDS, frames=0, rate=50)
    with World(path) as world:
        world.runs("steps", "walkers", "water", "eye", "screen", "noise")
        yield world


@pytest.fixture
def attack(door, keys):
    """Opens sessions with valid certificates."""
    sessions = []

    def begin(name):
        sessions.append(open_client(name, door, own=keys.credentials(name)))
        return sessions[-1]

    yield begin
    for session in sessions:
        session.close()


def answers(session, key):
    return list(session.get(key, payload=b"\x81\xa3ask\xa6status", timeout=5.0))


def counted(world, who, before, more):
    """Wait until exactly `more` additional rejections are counted."""
    eventually(lambda: refused(world, who) >= before + more, f"{more} of {who} are counted")
    goes_on(world)
    assert refused(world, who) == before + more


def test_an_honest_world_counts_no_refusal(world, door, keys):
    """Members of all roles join, leave, are killed and return. This test must run first."""
    who = ("--connect", door, "--world", world.name, "--keys", "keys/host.pem", "--name", "host")
    with (
        Joined(world, door, keys.credentials("sensor"), yard.Noise()),
        Joined(world, door, keys.credentials("eye"), yard.Water()),
        Joined(world, door, keys.credentials("watcher"), yard.Screen()),
        Run(world.folder, "attach", "yard:Walker", *who) as host,
    ):
        for name in ("sensor", "watcher", "host"):
            present(world, name)
        with Client(door, world.name, keys.credentials("ann")) as ann:
            assert ann.ask("scene")["scene"]
            ann.operator.pause()
            ann.operator.resume()
        host.kill(signal.SIGKILL)
        world.says("host │")
        goes_on(world)
    with Run(world.folder, "attach", "yard:Walker", *who) as host:
        present(world, "host")
        host.kill(signal.SIGTERM)
        assert host.ends() == 0, host.text
    goes_on(world)
    assert status(world).refused == {}
    assert "Zenoh drops it" not in world.text


def test_publishing_as_the_coordinator_is_attributed_and_counted(world, attack):
    session, base = attack("sensor"), f"minerva/{world.name}"
    before = refused(world, "sensor")
    tick = session.declare_keyexpr(f"{base}/tick")  # A publisher detects missing subscribers.
    for _ in range(3):
        put(session, tick, EVIL)
        put(session, f"{base}/all", EVIL)
    counted(world, "sensor", before, 6)
    for key in ("tick", "all"):
        world.says(f"sensor │ published on {base}/{key}, which its certificate does not allow")
    listed = here(world.folder, "list", "--json", "--world", world.name)
    assert json.loads(listed.stdout)["refused"]["sensor"] == before + 6


def test_a_subscription_to_everything_is_attributed_and_counted(world, attack):
    session, before = attack("sensor"), refused(world, "sensor")
    kept = [
        session.declare_subscriber(key, print) for key in ("**", f"minerva/{world.name}/from/*")
    ]
    counted(world, "sensor", before, 2)
    world.says("sensor │ subscribed to **, which its certificate does not allow")
    world.says(f"sensor │ subscribed to minerva/{world.name}/from/*, which")
    del kept


def test_a_reply_in_another_name_is_attributed_and_counted(world, attack):
    session, before, base = attack("sensor"), refused(world, "sensor"), f"minerva/{world.name}"
    put(session, f"{base}/from/steps", EVIL)
    kept = session.declare_queryable(f"{base}/control/ann", print)
    token = session.liveliness().declare_token(f"{base}/alive/somebody")
    counted(world, "sensor", before, 3)
    world.says(f"sensor │ published on {base}/from/steps, which")
    world.says(f"sensor │ declared a queryable on {base}/control/ann, which")
    world.says(f"sensor │ declared a liveliness token on {base}/alive/somebody, which")
    assert "somebody" not in world.members()
    del kept, token


def test_a_query_in_another_name_is_attributed_and_counted(world, attack):
    session, before, base = attack("watcher"), refused(world, "watcher"), f"minerva/{world.name}"
    for key in ("control", "control/ann", "ask/ann"):
        assert answers(session, f"{base}/{key}") == []
    counted(world, "watcher", before, 3)
    world.says(f"watcher │ queried {base}/control, which its certificate does not allow")
    world.says(f"watcher │ queried {base}/ask/ann, which its certificate does not allow")
    # It is logged once per kind of key.
    assert f"queried {base}/control/ann" not in world.text


def test_a_reading_that_is_too_large_is_named_and_counted(world, attack):
    session, before = attack("giant"), refused(world, "giant")
    key = f"minerva/{world.name}/topic/scan/giant"
    put(session, key, EVIL)
    put(session, key, bytes(65536))
    for _ in range(2):
        put(session, key, bytes(65537))
    counted(world, "giant", before, 2)
    world.says(f"giant │ published too large a message on {key}, more than 65536 bytes")


def test_a_member_confined_to_topics_is_counted_beyond_them(world, attack):
    session, before = attack("quiet"), refused(world, "quiet")
    put(session, f"minerva/{world.name}/topic/battery/quiet", EVIL)
    put(session, f"minerva/{world.name}/topic/scan/quiet", EVIL)
    counted(world, "quiet", before, 1)


def test_one_of_a_family_is_counted_for_it(world, door, keys):
    own, before = keys.credentials("gauges-a"), refused(world, "gauges-*")
    with open_client("gauges-a", door, own=own) as session:
        put(session, f"minerva/{world.name}/from/sensor", EVIL)
        counted(world, "gauges-*", before, 1)
    world.says(f"gauges-* │ published on minerva/{world.name}/from/sensor, which")


def test_a_flood_is_counted_in_full_and_logged_once(world, attack):
    session, base = attack("flooder"), f"minerva/{world.name}"
    for n in range(20_000):
        put(session, f"{base}/from/nobody{n}", EVIL)
    counted(world, "flooder", 0, 20_000)
    assert world.text.count("flooder │ published on") == 1


def test_a_key_cannot_forge_an_accusation(world, attack):
    session, base = attack("forger"), f"minerva/{world.name}"
    before = status(world).refused
    another = TLS.replace("sensor", "ann")
    forged = (ruled("Put", "minerva/w/tick", on=f" on {another}") + entry(DROPPED)).decode()
    put(session, f"{base}/a\n{forged}", EVIL)
    put(session, f"{base}/b\nzenoh_link_tls::unicast: no certificate", EVIL)
    counted(world, "forger", 0, 2)
    assert status(world).refused == {**before, "forger": 2}
    assert "no certificate" not in "".join(line[line.find("│") :][:20] for line in world.lines)
    assert world.text.count("forger │") == 1
