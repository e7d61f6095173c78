"""The server of pages, with real worlds: who is admitted, and what ends a link."""

import json
import ssl
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

pytest.importorskip("websockets")

from page_run import copied, eventually, running
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from minerva_bus.wire.plain import pack
from minerva_services.geometry.colors import SCALES
from minerva_services.views.palette import person_colour
from tests.patience import patience


@pytest.fixture(scope="module")
def garden(tmp_path_factory):
    folder = tmp_path_factory.mktemp("garden")
    with running(folder, copied(folder) / "phone.toml") as run:
        yield run


def opened(address, context=None, **headers):
    """The status of a response, its text and its headers."""
    request = urllib.request.Request(address, headers=headers)
    try:
        with urllib.request.urlopen(request, context=context) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(), error.headers


def cookie_of(run, context=None):
    return opened(run.url, context)[2]["Set-Cookie"].partition(";")[0]


def linked(run, path, origin="", **headers):
    """A WebSocket of the page's server."""
    return connect(
        run.base.replace("http", "ws", 1) + path,
        origin=origin or run.base,
        additional_headers={"Cookie": cookie_of(run)} | headers,
        open_timeout=patience(10),
        max_size=1 << 20,
    )


def refused(run, path, **options):
    """The status and the reason with which a WebSocket is refused."""
    with pytest.raises(InvalidStatus) as caught:
        linked(run, path, **options)
    response = caught.value.response
    return response.status_code, response.body.decode()


def messages(socket, name):
    """Wait for a message of the server that has a key."""
    while True:
        message = json.loads(socket.recv())
        if name in message:
            return message[name]


def test_the_address_admits_and_nothing_else_does(garden):
    status, page, headers = opened(garden.url)
    assert status == 200
    assert "importmap" in page
    assert "HttpOnly; SameSite=Strict" in headers["Set-Cookie"]
    assert "Secure" not in headers["Set-Cookie"]
    for name in ("Content-Security-Policy", "Referrer-Policy", "X-Content-Type-Options"):
        assert headers[name]
    assert opened(f"{garden.base}/page.js")[:2] == (
        403,
        "the token is missing or wrong: open the whole address that was printed\n",
    )
    assert opened(f"{garden.base}/?token=guessed")[0] == 403
    assert opened(f"{garden.base}/page.js", Cookie=cookie_of(garden))[0] == 200
    assert opened(f"{garden.base}/nothing.js", Cookie=cookie_of(garden))[0] == 404
    assert "rejected 127.0.0.1: the token is missing" in garden.line("the token is missing")


@pytest.mark.parametrize("path", ["/people", "/bus?name=page-7"])
def test_links_need_token_origin_and_host(garden, path):
    assert refused(garden, path, Cookie="")[0] == 403
    status, reason = refused(garden, path, origin="http://evil.example")
    assert (status, reason) == (403, "a page of 'http://evil.example' may not use this page\n")
    assert "evil.example" in garden.line("a page of 'http://evil.example'")
    assert refused(garden, path, origin="null")[0] == 403
    with pytest.raises(InvalidStatus):
        connect(f"ws://localhost:{garden.base.rpartition(':')[2]}{path}", origin=garden.base)
    assert opened(garden.base + path, Cookie=cookie_of(garden), Host="evil.example")[0] == 403
    assert opened(garden.base + path, Cookie=cookie_of(garden))[0] == 426


def test_a_page_takes_a_name_of_its_own_only(garden):
    assert refused(garden, "/bus?name=sky") == (409, "pages may not take part as 'sky'\n")
    assert refused(garden, "/bus")[0] == 409
    garden.line("pages may not take part as 'sky'")
    with linked(garden, "/bus?name=page-8"):
        taken = 409, "page-8 takes part in another page\n"
        assert refused(garden, "/bus?name=page-8") == taken
    eventually(lambda: not raised(garden, "/bus?name=page-8"), "the name is not free again")


def raised(run, path):
    try:
        linked(run, path).close()
    except InvalidStatus:
        return True
    return False


@pytest.mark.parametrize("text", [b"\x1f", b"", "text", b"\x25\x00\x1e\x26\x01\x00\x01a"])
def test_a_link_that_sends_something_else_is_closed_with_a_reason(garden, text):
    with linked(garden, "/bus?name=page-9") as socket:
        socket.send(text)
        with pytest.raises(ConnectionClosed) as caught:
            socket.recv()
        assert caught.value.rcvd.code == 1008
        assert caught.value.rcvd.reason
    garden.line("page-9 is cut off: ")


def test_a_page_learns_where_it_is_and_sends_orders(garden):
    with linked(garden, "/people") as socket:
        welcome = messages(socket, "welcome")
        assert welcome == {
            "world": "phone", "page": "page-1", "draws": ["ePicture"], "rate": 15.0,
            "scales": {name: list(colors) for name, colors in SCALES.items()},
            "beside": "", "module": "/modules/garden.js", "joins": {"snails": "snails", "tilt-*": "tilt-1"},
            "you": {"name": "page-1", "colour": person_colour("page-1")},
        }  # fmt: skip
        status = messages(socket, "status")
        while not status["types"].get("place"):
            status = messages(socket, "status")
        assert status["types"] == {"click": None, "slide": None, "place": "eLettuce", "plain": []}
        for order, reason in (
            ("nonsense", "JSON"),
            ("[]", "JSON"),
            ("[" * 10_000, "JSON"),
            ("{}", "does not know"),
            ('{"order": "eNothing", "data": {}, "to": []}', "no event type 'eNothing'"),
            ('{"order": "eLettuce", "data": {"receivers": 1}, "to": []}', "no 'receivers'"),
            ('{"order": "eLettuce", "data": {"x": "far", "y": 0}, "to": []}', "x"),
            ('{"order": "eLettuce", "data": {}, "to": []}', "x"),
            ('{"order": "eLettuce", "data": {"x": NaN, "y": 0}, "to": []}', "x"),
            ('{"order": "eLettuce", "data": {"x": 1, "y": 2}, "to": [3]}', "ids"),
            ('{"order": "eRain", "data": {}, "to": []}', "eRain"),
            ('{"name": "a/b"}', "cannot name a person"),
            ('{"name": "snails"}', "another page or person"),
            ('{"state": "nobody"}', "no agent #nobody"),
            ('{"seek": 3}', "not a replay"),
            ('{"rate": 1000}', "does not know"),
        ):
            socket.send(order)
            assert reason in messages(socket, "error"), order
        rate = garden.client.operator.status().rate
        for steps, wanted in (1, 2 * rate), (-1, rate):
            socket.send(json.dumps({"rate": steps}))
            assert messages(socket, "note") == f"target rate {wanted:g} frames per second"
            assert garden.client.operator.status().rate == wanted
        socket.send('{"bisect": true}')
        assert messages(socket, "bisected")["problem"].endswith("--view page:beside=FILE")
        with linked(garden, "/people") as other:
            assert messages(other, "welcome")["page"] == "page-2"


def test_a_page_that_asks_for_another_port_or_type_ends_the_world(tmp_path):
    for view, reason in (
        ("page:draws=eNothing", "draws is 'eNothing'"),
        ("page:host=192.0.2.1", "cannot listen at 192.0.2.1"),
        ("page:click=eRain", "click is 'eRain'"),
    ):
        done = subprocess.run(
            [*MINERVA, "run", "robot", "--view", view, "--frames", "5"],
            capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode != 0
        assert reason in done.stderr
        assert "Traceback" not in done.stderr


def test_a_world_in_one_process_has_no_pages():
    done = subprocess.run(
        [*MINERVA, "run", "robot", "--view", "page", "--frames", "5", "--in-process"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode != 0
    assert "run without --in-process" in done.stderr
    assert "Traceback" not in done.stderr


MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]


@pytest.fixture
def keys(tmp_path):
    pytest.importorskip("cryptography")
    command = [*MINERVA, "keys", "init", "--dir", str(tmp_path / "keys")]
    subprocess.run(command, check=True, capture_output=True)
    return tmp_path / "keys"


HELLO = {
    "version": 7, "kinds": [], "generates": ["eLettuce"], "when": "freely", "orders": [],
    "draws": [], "coupled": False, "topics": [], "publishes": [], "about": {"service": "a page"},
}  # fmt: skip


def answer_to_hello(socket, world, name):
    """What the coordinator answers to a page's hello; bytes as in zenoh-wire.md."""

    def text(key):
        return bytes([0, len(key)]) + key.encode()

    def received(part):
        while part not in (batch := socket.recv()):
            pass
        return batch

    socket.send(bytes.fromhex("41093201020304 0affff"))
    accepted = socket.recv()
    assert accepted[0] & 0x1F == 1
    cookie = accepted[3 + (accepted[2] >> 4) + 1 + (3 if accepted[0] & 0x40 else 0) :]
    socket.send(b"\x42\x03\0" + cookie[: 1 + cookie[0]])
    base = f"minerva/{world}"
    socket.send(b"\x25\0\x1e\x22\x01" + text(f"{base}/to/{name}"))
    socket.send(b"\x25\1\x1e\x26\x02" + text(f"{base}/alive/{name}"))
    greet = received(b"\x91\xa5greet")
    end = greet.index(b"\x91\xa5greet")
    payload = greet[end - 5 : end] + pack(["hello", HELLO])
    length = bytes([len(payload) & 0x7F | 0x80, len(payload) >> 7])
    put = b"\x25\2\xbd" + text(f"{base}/from/{name}") + b"\x21\x0d\x01"
    socket.send(put + length + payload)
    return received(b"\xa7refused").partition(b"refused")[2].decode(errors="replace")


def test_a_world_with_keys_has_pages_over_tls(tmp_path, keys):
    """The page uses the coordinator's certificate; links go on by the world's local socket.

    A certificate of page-* restricts what pages may do, although their links are local.
    """
    family = ["issue", "page", "--family", "--role", "view", "--dir", str(keys)]
    subprocess.run([*MINERVA, "keys", *family], check=True, capture_output=True)
    folder = copied(tmp_path)
    text = (folder / "phone.toml").read_text()
    certificate = f'certificate = "{keys / "coordinator.pem"}"\nmodule ='
    (folder / "phone.toml").write_text(text.replace("module =", certificate))
    arguments = folder / "phone.toml", "--listen", "tls/127.0.0.1:0", "--keys", keys
    with running(tmp_path, *arguments, scheme="https") as run:
        context = ssl.create_default_context(cafile=str(keys / "ca.pem"))
        status, _, headers = opened(run.url, context)
        assert status == 200
        assert headers["Set-Cookie"].endswith("; Secure")
        with connect(
            run.base.replace("http", "ws", 1) + "/bus?name=page-7",
            ssl=context,
            origin=run.base,
            additional_headers={"Cookie": cookie_of(run, context)},
        ) as socket:
            answer = answer_to_hello(socket, run.client.world, "page-7")
            assert "its certificate is for view, not for generator" in answer
        with pytest.raises((urllib.error.URLError, OSError)):
            opened(run.url.replace("https", "http", 1))


def test_a_world_with_keys_serves_other_machines_over_tls_only(tmp_path, keys):
    arguments = ["robot", "--view", "page:host=0.0.0.0", "--listen", "tls/127.0.0.1:0"]
    done = subprocess.run(
        [*MINERVA, "run", *arguments, "--keys", str(keys), "--frames", "5"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode != 0
    assert "certificate=keys/coordinator.pem" in done.stderr


def test_the_token_lasts_for_one_run(tmp_path, monkeypatch):
    from minerva_services.web_access import token_for

    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "runtime"))
    first = token_for(9000, "17")
    assert token_for(9000, "17") == first
    assert token_for(9001, "17") != first
    second = token_for(9000, "18")
    assert second != first
    assert token_for(9000, "18") == second
