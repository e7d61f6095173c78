"""The MQTT bridge with a real broker: input, output, TLS, reconnection, garbage, floods."""

import shutil
import socket
import subprocess
import threading

import pytest
from mosquitto import Mosquitto, needs_mosquitto, running

from minerva_bus import (
    Default,
    EventType,
    Metres,
    MinervaError,
    Motion,
    Primitive,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
)

pytest.importorskip("paho.mqtt")
from minerva_services.bridges.mqtt import Mqtt
from minerva_services.bridging import SourceError
from tests.patience import eventually, patience

pytestmark = needs_mosquitto

eTemperature = EventType("eTemperature", celsius=float)
eMotion = EventType("eMotion", on=bool)
eShow = EventType("eShow", visual=True)
PHeater = Primitive("PHeater", on=bool, power=float)
PRobot = Primitive("PRobot", name=str)
TRoom = Transformation("TRoom", room=str)
TMove = Transformation("TMove", Motion("x", "y"), x=Metres, y=Default(Metres, 0.0))
VOCABULARY = Vocabulary.of(eTemperature, eMotion, eShow, PHeater, PRobot, TRoom, TMove)
IN = {"home/{room}/temperature": {"event": "eTemperature", "receivers": ["{room}"]}}
OUT = {"PHeater": {"topic": "home/{room}/heater/set", "payload": "{on}"}}


@pytest.fixture
def broker(tmp_path):
    mosquitto = Mosquitto(tmp_path)
    yield mosquitto
    mosquitto.kill()


def bridge(broker, **options):
    address = broker if isinstance(broker, str) else broker.address
    service = Mqtt(address, **({"topics": IN} | options))
    service.joined(WorldInfo("test", VOCABULARY, 0, 0.1))
    return service


def is_open(service):
    return lambda: service.report()["source"] == "open"


def show(service, text):
    service.show(View(0, "eShow", VOCABULARY.read(text)))


def ready(service, client, heard):
    """Wait until the broker forwards messages to the bridge."""

    def there():
        client.publish("home/ready/temperature", "0")
        return heard

    eventually(there, "the bridge hears")


def test_a_message_becomes_an_event(broker):
    service = bridge(broker)
    with running(service) as heard, broker.client() as client:
        ready(service, client, heard)
        client.publish("home/kitchen/temperature", "21.5")
        wanted = eTemperature(21.5, receivers=["kitchen"])
        eventually(lambda: wanted in heard, "the event is there")


def test_retained_messages_count_if_they_shall(broker):
    with broker.client() as client:
        client.publish("home/hall/temperature", "7", 1, retain=True).wait_for_publish()
    for counts in (True, False):
        table = IN["home/{room}/temperature"] | {"retained": counts}
        service = bridge(broker, topics={"home/{room}/temperature": table})
        with running(service) as heard:
            what = "events" if counts else "passed over"
            eventually(lambda s=service, w=what: s.report().get(w), what)
        assert (eTemperature(7.0, receivers=["hall"]) in heard) is counts


def test_garbage_is_counted_and_reported_once(broker, capfd):
    service = bridge(broker)
    with running(service) as heard, broker.client() as client:
        ready(service, client, heard)
        for garbage in (
            b"\xff\xfe",
            b"warm",
            b"{",
            b"[" * 60_000,
            b"nan",
            b"1" * 70_000,
            b'{"x": 1}',
        ):
            client.publish("home/kitchen/temperature", garbage)
        eventually(lambda: service.report().get("garbage") == 7, "garbage is counted")
        client.publish("home/kitchen/temperature", "22")
        eventually(lambda: eTemperature(22.0, receivers=["kitchen"]) in heard, "it goes on")
    assert capfd.readouterr().out.count("garbage\n") == 1


def test_a_flood_is_received_completely(broker):
    service = bridge(broker, most=0)
    with running(service) as heard, broker.client() as client:
        ready(service, client, heard)
        before = len(heard)
        for number in range(1, 5001):
            client.publish("home/kitchen/temperature", str(number), 1)
        eventually(lambda: eTemperature(5000.0, receivers=["kitchen"]) in heard, "the last")
        flood = [reading.celsius for reading in heard[before:] if reading.celsius > 0]
        assert flood == [float(number) for number in range(1, 5001)]


def test_a_flood_above_what_is_allowed_waits_and_drops(broker, monkeypatch):
    monkeypatch.setattr("minerva_services.bridges.mqtt.service.MAX_QUEUED", 100)
    service = bridge(broker, most=1)
    with running(service) as heard, broker.client() as client:
        eventually(is_open(service), "open")
        for _ in range(5000):
            client.publish("home/kitchen/temperature", "1", 1)
        eventually(lambda: service.report().get("messages") == 5000, "all have come")
        counted = service.report()
        assert counted["dropped"] + 100 + len(heard) >= 5000
        assert counted["dropped"] > 4000


def test_a_broker_that_dies_and_returns(broker, capfd):
    service = bridge(broker, publish=OUT)
    with running(service) as heard:
        with broker.client("home/#") as client:
            ready(service, client, heard)
            show(service, 'TRoom<room="bath">(PHeater<on=true, power=1>)')
            command = ("home/bath/heater/set", b"ON", False)
            eventually(lambda: command in client.heard, "published")
        broker.kill()
        eventually(lambda: service.report().get("failures"), "the loss is noticed")
        show(service, 'TRoom<room="bath">(PHeater<on=false, power=1>)')
        show(service, 'TRoom<room="bath">(PHeater<on=true, power=1>)')
        assert "127.0.0.1" in service.report()["source"]
        broker.start()
        heard.clear()
        with broker.client("home/#") as client:
            ready(service, client, heard)
    said = capfd.readouterr().out
    assert "retrying\n" in said
    assert f"mqtt: the broker 127.0.0.1:{broker.port} is back\n" in said


def test_retained_messages_are_published_again_to_a_restarted_broker(broker):
    service = bridge(broker, topics={}, publish={"PHeater": OUT["PHeater"] | {"retain": True}})
    show(service, 'TRoom<room="bath">(PHeater<on=true, power=1>)')
    with running(service):
        eventually(lambda: service.report().get("published"), "published")
        broker.kill()
        eventually(lambda: service.report().get("failures"), "lost")
        show(service, 'TRoom<room="bath">(PHeater<on=false, power=1>)')
        broker.start()
        with broker.client("home/#") as client:
            wanted = ("home/bath/heater/set", b"OFF")
            eventually(lambda: wanted in [m[:2] for m in client.heard], "the newest is there")


def test_views_are_published_where_they_change(broker):
    publish = {
        "PHeater": "home/{room}/heater",
        "PRobot": {"topic": "robots/{name}", "payload": "{x} {y}", "gone": "gone"},
    }
    service = bridge(broker, topics={}, publish=publish, draws="eShow")
    assert service.draws == ("eShow",)
    with running(service), broker.client("home/#", "robots/#") as client:
        eventually(is_open(service), "open")
        heater = 'TRoom<room="hall">(PHeater<on=true, power=1.5>)'
        for x in (1, 1, 2):
            show(service, f'{heater} · TMove<x={x}>(TMove<x=1, y=0.5>(PRobot<name="r">))')
            count = 2 if x == 1 else 3
            eventually(lambda n=count: len(client.heard) == n, f"{count} messages")
        show(service, heater)
        eventually(lambda: len(client.heard) == 4, "gone")
    assert [message[:2] for message in client.heard] == [
        ("home/hall/heater", b'{"on": true, "power": 1.5}'),
        ("robots/r", b"2.0 0.5"),
        ("robots/r", b"3.0 0.5"),
        ("robots/r", b"gone"),
    ]


def test_names_that_are_no_topic_are_counted(broker, capfd):
    service = bridge(broker, topics={}, publish={"PRobot": "robots/{name}"})
    for _ in range(2):
        show(service, 'PRobot<name="a/#">')
    assert service.report()["unpublished"] == 2
    assert capfd.readouterr().out.count("cannot stand in a topic") == 1


def test_a_payload_with_a_name_that_is_not_there_is_not_published(broker, capfd):
    heater = {"topic": "heaters", "payload": "{room} {on}"}
    service = bridge(broker, topics={}, publish={"PHeater": heater})
    show(service, "PHeater<on=true, power=1>")
    assert service.report()["unpublished"] == 1
    assert "no transformation around it has room" in capfd.readouterr().out


def test_a_transformation_names_what_is_in_it_and_no_more(broker):
    service = bridge(broker, topics={}, publish=OUT)
    heater = "PHeater<on=true, power=1>"
    show(service, f'TRoom<room="a">(TRoom<room="b">({heater}) · {heater}) · {heater}')
    assert service.report() == {"unpublished": 1, "source": "not open yet"}
    with running(service), broker.client("home/#") as client:
        show(service, f'TRoom<room="c">({heater})')
        eventually(lambda: ("home/c/heater/set", b"ON") in [m[:2] for m in client.heard], "c")
        assert {m[0] for m in client.heard} <= {f"home/{room}/heater/set" for room in "abc"}


def test_it_reports_whether_it_is_present(broker):
    service = bridge(broker, status="minerva/status")
    with broker.client("minerva/status") as client:
        with running(service):
            eventually(lambda: client.heard, "it is there")
        eventually(lambda: len(client.heard) == 2, "it has left")
        assert [message[1] for message in client.heard] == [b"online", b"offline"]
        lost = bridge(broker, status="minerva/status").open()
        eventually(lambda: len(client.heard) == 3, "it is there")
        lost._connection._close_socket()
        eventually(lambda: len(client.heard) == 4, "its last will")
        assert client.heard[-1][1] == b"offline"


def test_messages_while_it_was_away_are_kept_for_its_client_id(broker):
    options = {"client": "house", "keeps": True, "qos": 1}
    with broker.client() as client:
        service = bridge(broker, **options)
        with running(service) as heard:
            ready(service, client, heard)
        sent = client.publish("home/kitchen/temperature", "17", 1)
        sent.wait_for_publish()
        with running(bridge(broker, **options)) as heard:
            wanted = eTemperature(17.0, receivers=["kitchen"])
            eventually(lambda: wanted in heard, "it was kept")


# --- identities -----------------------------------------------------------------------------------


def test_user_and_password(tmp_path, monkeypatch, capfd):
    passwords = tmp_path / "passwords"
    passwords.touch(0o600)
    subprocess.run(["mosquitto_passwd", "-b", passwords, "ann", "s3cret"], check=True)
    broker = Mosquitto(tmp_path, "allow_anonymous false", f"password_file {passwords}", "user root")
    try:
        monkeypatch.setenv("HOUSE_PASSWORD", "s3cret")
        service = bridge(broker, user="ann", password_env="HOUSE_PASSWORD")
        with running(service):
            eventually(is_open(service), "open")
        (tmp_path / "word").write_text("wrong\n")
        service = bridge(broker, user="ann", password_file=str(tmp_path / "word"))
        with pytest.raises(SourceError, match="connection refused: Not authorized"):
            service.open()
        (tmp_path / "word").write_text("s3cret\n")
        service.open().close()
    finally:
        broker.kill()
    assert "s3cret" not in capfd.readouterr().out


def openssl(folder, *words):
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)


@pytest.fixture
def certificates(tmp_path):
    """A certificate authority and its certificate for 127.0.0.1."""
    new = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2"]
    usage = ["-addext", "keyUsage=critical,keyCertSign,cRLSign"]
    openssl(
        tmp_path,
        "req",
        "-x509",
        *new,
        "-keyout",
        "ca.key",
        "-out",
        "ca.pem",
        "-subj",
        "/CN=ca",
        *usage,
    )
    openssl(tmp_path, "req", *new[:-2], "-keyout", "b.key", "-out", "b.csr", "-subj", "/CN=b")
    (tmp_path / "ext").write_text(
        "subjectAltName=IP:127.0.0.1\nauthorityKeyIdentifier=keyid\nbasicConstraints=CA:FALSE\n"
    )
    openssl(tmp_path, "x509", "-req", "-in", "b.csr", "-CA", "ca.pem", "-CAkey", "ca.key",
            "-CAcreateserial", "-days", "2", "-out", "b.pem", "-extfile", "ext")  # fmt: skip
    (tmp_path / "b.key").chmod(0o644)
    return tmp_path


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl")
def test_tls(certificates):
    files = {name: str(certificates / name) for name in ("ca.pem", "b.pem", "b.key")}
    broker = Mosquitto(
        certificates, "allow_anonymous true", "user root",
        f"cafile {files['ca.pem']}", f"certfile {files['b.pem']}", f"keyfile {files['b.key']}",
    )  # fmt: skip
    address = f"mqtts://127.0.0.1:{broker.port}"
    try:
        service = bridge(address, ca=files["ca.pem"])
        with running(service) as heard, broker.client(ca_certs=files["ca.pem"]) as client:
            ready(service, client, heard)
        with pytest.raises(SourceError, match=r"its certificate: .*certificate"):
            bridge(address).open()
        with pytest.raises(SourceError, match="the broker"):
            bridge(broker).open()
    finally:
        broker.kill()
    with pytest.raises(MinervaError, match=r"ca: file nowhere\.pem does not exist"):
        bridge(address, ca="nowhere.pem")
    with pytest.raises(MinervaError, match="not matching PEM files"):
        bridge(address, ca=files["b.key"])


# --- no broker ------------------------------------------------------------------------------------


def test_no_listener(broker):
    broker.kill()
    with pytest.raises(SourceError, match=f"127.0.0.1:{broker.port}: .*refused"):
        bridge(broker).open()


def test_a_server_that_is_not_a_broker():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def answer():
            there, _ = server.accept()
            there.recv(100)
            there.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
            there.close()

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(SourceError, match=f"the broker 127.0.0.1:{port}"):
            bridge(f"mqtt://127.0.0.1:{port}").open()
        thread.join(patience())


def test_a_server_that_never_answers(monkeypatch):
    monkeypatch.setattr("minerva_services.bridges.mqtt.connection.CONNECT_SECONDS", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(SourceError, match="no MQTT handshake"):
            bridge(f"mqtt://127.0.0.1:{port}").open()
