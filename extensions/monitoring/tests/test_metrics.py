"""Metrics for Prometheus, and health checks for orchestrators."""

import socket
import struct
import urllib.request
from dataclasses import replace
from urllib.error import HTTPError

import pytest

from minerva_bus.errors import BusError, MisuseError, ProtocolError
from minerva_bus.runtime.metrics import BOUNDS, Durations, Totals
from minerva_bus.wire.plain import pack, unpack
from minerva_bus.wire.status_codec import plain_status
from minerva_bus.world.operator import MemberStatus, WorldStatus
from minerva_monitoring.metrics_server import Exporter, address, live, read_totals, ready

pytest.importorskip("prometheus_client")
from prometheus_client.parser import text_string_to_metric_families

STATUS = WorldStatus(
    "pond", frame=7, dt=0.1, phase="events", rate=30.0, hz=29.5, agents=4,
    members=(
        MemberStatus("host", "present", ("agents",), joins=3, late=2, wait=1500.0),
        MemberStatus("water", "late", ("generator", "device"), joins=1,
                     figures={"dropped": 5}),
        MemberStatus("lost", "lost"),
    ),
    refused={"mallory": 12},
)  # fmt: skip


def totals():
    totals = Totals()
    for micro in (400.0, 30_000.0, 9e7):
        totals.add({"frame": micro, "tick": micro / 2, "wait for host": 3.0, "bytes in": 100.0})
    totals.events = {"eStep": 21}
    return totals


class World:
    """A coordinator's client that returns a fixed status; with `gone` it fails."""

    def __init__(self, status=STATUS):
        self.status, self.gone, self.asked = status, False, []

    def ask(self, question, **_):
        self.asked.append(question)
        if self.gone:
            raise BusError("no world 'pond' answers")
        if question == "status":
            return {"status": unpack(pack(plain_status(self.status)))}
        return {"totals": unpack(pack(totals().plain()))}


@pytest.fixture
def world():
    return World()


@pytest.fixture
def url(world):
    with Exporter("pond", "127.0.0.1:0", world.ask) as exporter:
        yield exporter.url.removesuffix("/metrics")


def got(url):
    try:
        with urllib.request.urlopen(url) as reply:
            return reply.status, reply.read().decode()
    except HTTPError as refused:
        return refused.code, refused.read().decode()


def samples(url):
    families = text_string_to_metric_families(got(f"{url}/metrics")[1])
    return {
        (sample.name, *sorted(sample.labels.items())): sample.value
        for family in families
        for sample in family.samples
    }


def test_every_metric_has_a_world_label(url):
    metrics = samples(url)
    assert metrics["minerva_up", ("world", "pond")] == 1
    assert metrics["minerva_frame", ("world", "pond")] == 7
    assert all(("world", "pond") in key for key in metrics)


def test_durations_are_counted_in_seconds_and_cumulate(url):
    metrics = samples(url)
    where = (("phase", "frame"), ("world", "pond"))
    buckets = {
        dict(key[1:])["le"]: value
        for key, value in metrics.items()
        if key[0] == "minerva_frame_phase_seconds_bucket" and where[0] in key
    }
    assert buckets["0.00025"] == 0
    assert buckets["0.0005"] == 1
    assert buckets["0.05"] == 2
    assert buckets["10.0"] == 2
    assert buckets["+Inf"] == metrics["minerva_frame_phase_seconds_count", *where] == 3
    assert metrics["minerva_frame_phase_seconds_sum", *where] == pytest.approx(90.0304)
    assert not any(("phase", "wait for host") in key for key in metrics)


def test_members_and_events_are_counted(url):
    metrics = samples(url)
    host, water = (("member", name) for name in ("host", "water"))
    of = ("world", "pond")
    assert metrics["minerva_restarts_total", host, of] == 2
    assert metrics["minerva_restarts_total", water, of] == 0
    assert metrics["minerva_late_answers_total", host, of] == 2
    assert metrics["minerva_dropped_events_total", water, of] == 5
    assert metrics["minerva_member_wait_seconds", host, of] == pytest.approx(0.0015)
    assert metrics["minerva_members", ("role", "device"), ("state", "late"), of] == 1
    assert metrics["minerva_members", ("role", "none"), ("state", "lost"), of] == 1
    assert metrics["minerva_events_total", ("type", "eStep"), of] == 21
    assert metrics["minerva_bytes_total", ("direction", "in"), of] == 300
    assert metrics["minerva_refused_total", ("who", "mallory"), of] == 12


def test_a_world_that_does_not_answer_is_down(url, world):
    world.gone = True
    assert samples(url) == {("minerva_up", ("world", "pond")): 0}
    assert got(f"{url}/live") == (
        503, "the coordinator does not answer: no world 'pond' answers\n",
    )  # fmt: skip
    assert got(f"{url}/ready")[0] == 503
    world.gone = False
    assert got(f"{url}/live") == (200, "pond: the coordinator answers\n")


def test_another_path_is_not_there(url):
    assert got(f"{url}/") == (404, "not found; expected /metrics, /live or /ready\n")


@pytest.mark.parametrize(
    "headers", [{"Host": "evil.example"}, {"Host": "x"}, {"Origin": "http://["}, {"Origin": "null"}]
)
@pytest.mark.parametrize("path", ["/metrics", "/live"])
def test_other_names_and_pages_of_other_sites_are_refused(url, path, headers):
    request = urllib.request.Request(f"{url}{path}", headers=headers)
    with pytest.raises(HTTPError) as refused:
        urllib.request.urlopen(request)
    assert refused.value.code == 403


def test_a_connection_that_is_reset_is_no_error(url, world, capfd):
    port = int(url.rpartition(":")[2])
    for text in (b"GET", b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n"):
        for _ in range(10):
            with socket.create_connection(("127.0.0.1", port)) as client:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                client.sendall(text)
    world.status = None  # What code of ours raises is one line.
    with pytest.raises(OSError, match="closed"):
        got(f"{url}/metrics")
    printed = capfd.readouterr().err.splitlines()
    assert printed
    assert all(line.startswith("metrics: no reply to 127.0.0.1: TypeError: ") for line in printed)


def test_a_world_is_ready_while_it_runs_or_rests():
    assert ready(STATUS).text == "pond: running frame 7"
    assert ready(replace(STATUS, paused=True)).text == "pond: paused before frame 7"
    assert ready(replace(STATUS, waiting=("host",), waited=0.4)).ok


def test_a_waiting_world_is_not_ready_and_names_the_members():
    gathering = replace(STATUS, phase="gathering members", waiting=("a", "b"))
    assert (ready(gathering).code, ready(gathering).text) == (503, "pond: waiting for a, b to join")
    stuck = replace(STATUS, waiting=("host",), waited=3.25)
    assert ready(stuck).text == "pond: frame 7 has been waiting for host for 3.2 s"
    assert (ready(stuck).code, live(stuck).code) == (503, 200)


@pytest.mark.parametrize("listen", ["9464", "localhost", ":9464", "localhost:x", "localhost:70000"])
def test_an_invalid_address_is_rejected(listen):
    with pytest.raises(MisuseError, match="expected HOST:PORT"):
        address(listen)


def test_addresses_may_be_of_either_family():
    assert address("0.0.0.0:9464") == ("0.0.0.0", 9464)
    assert address("[::1]:80") == ("::1", 80)


def test_a_port_in_use_is_reported(world):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(BusError, match=f"cannot serve metrics at 127.0.0.1:{port}.*in use"):
            Exporter("pond", f"127.0.0.1:{port}", world.ask)


def test_a_missing_library_names_its_extra(monkeypatch, world):
    monkeypatch.setattr("minerva_monitoring.metrics_server.find_spec", lambda _: None)
    with pytest.raises(Exception, match=r"pip install 'minerva-bus\[metrics\]'"):
        Exporter("pond", "127.0.0.1:0", world.ask)


def test_totals_travel_whole():
    assert read_totals(unpack(pack(totals().plain()))) == totals()


@pytest.mark.parametrize(
    "change",
    [
        {"phases": {"tick": [[1, 2], 0.5]}},
        {"phases": {"tick": [[0] * (len(BOUNDS) + 1)]}},
        {"bytes": 3},
        {"frames": -1},
        {"events": {"eStep": "many"}},
    ],
)
def test_wrong_totals_are_refused(change):
    with pytest.raises(ProtocolError):
        read_totals({**totals().plain(), **change})


def test_a_duration_equal_to_a_bound_counts_within_it():
    durations = Durations()
    durations.add(BOUNDS[2])
    assert durations.counts[2] == 1
