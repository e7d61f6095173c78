"""A page is accessible only with its token, and not from pages of other sites."""

import socket
import struct
import urllib.error
import urllib.request
from types import SimpleNamespace

import hypothesis.strategies as st
import pytest
from hypothesis import given

pytest.importorskip("viser", reason="pip install 'minerva-bus[web]'")

import viser
from msgpack import packb
from page_run import eventually
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from minerva_services.views.page_access import announce
from minerva_services.views.web.serving import serve, stop, url
from minerva_services.web_access import WebAccess, forget_token, token_for
from tests.patience import patience

HERE = WebAccess("127.0.0.1", 8080, "secret")
ALL = WebAccess("0.0.0.0", 8080, "secret", frozenset({"robots.example.org"}))
COOKIE = "other=1; minerva-8080=secret"


@pytest.fixture
def server(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "runtime"))
    made = serve("127.0.0.1", 0)
    yield made
    stop(made)


def opened(address, **headers):
    """The status of a page's response, and its cookie."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers)) as page:
            return page.status, page.headers["Set-Cookie"] or ""
    except urllib.error.HTTPError as error:
        assert b"<html" not in error.read().lower()
        return error.code, ""


def page_of(server, origin=None, **headers):
    """A connection to the page."""
    address = f"ws://127.0.0.1:{server.get_port()}/"
    headers = headers or {"Cookie": server.access.cookie.partition(";")[0]}
    protocols = [f"viser-v{viser.__version__}"]
    options = {"origin": origin, "additional_headers": headers, "open_timeout": patience(10)}
    return connect(address, subprotocols=protocols, **options)


def handshake(server, origin=None, **headers):
    """The status of a WebSocket's handshake."""
    try:
        with page_of(server, origin, **headers or {"X-None": "1"}) as page:
            assert page.recv()
            return 101
    except InvalidStatus as error:
        return error.response.status_code


def test_the_printed_address_lets_a_browser_in_and_no_other_does(server):
    bare = f"http://127.0.0.1:{server.get_port()}/"
    status, cookie = opened(url(server))
    assert status == 200
    assert {"HttpOnly", "SameSite=Strict"} <= {part.strip() for part in cookie.split(";")}
    assert opened(bare)[0] == 403
    assert opened(f"{bare}?token=guessed")[0] == 403
    assert opened(bare, Cookie=cookie.partition(";")[0])[0] == 200


def test_the_scene_is_sent_to_the_page_itself_only(server):
    here = f"http://127.0.0.1:{server.get_port()}"
    cookie = server.access.cookie.partition(";")[0]
    assert handshake(server, here, Cookie=cookie) == 101
    assert handshake(server, None, Cookie=cookie) == 101  # a program, not a browser
    assert handshake(server, here) == 403
    assert handshake(server, "http://evil.example", Cookie=cookie) == 403
    assert handshake(server, "null", Cookie=cookie) == 403
    assert (
        handshake(
            server, here.replace("http", "https").replace("127.0.0.1", "localhost"), Cookie=cookie
        )
        == 403
    )
    assert handshake(server, None) == 403


@pytest.mark.parametrize(
    ("access", "host", "allowed"),
    [
        (HERE, "127.0.0.1:8080", True), (HERE, "localhost:8080", True), (HERE, "[::1]:8080", True),
        (HERE, "evil.example:8080", False), (HERE, "192.168.1.7:8080", False), (HERE, "", False),
        (HERE, "[", False), (HERE, "127.0.0.1.evil.example", False),
        (ALL, "192.168.1.7:8080", True), (ALL, "robots.example.org", True), (ALL, "evil.example", False),
    ],
)  # fmt: skip
def test_a_name_that_is_not_the_pages_is_refused(access, host, allowed):
    refusal = access.refusal("/", {"Host": host, "Cookie": COOKIE})
    assert (refusal == "") == allowed
    assert allowed or "not known as" in refusal


@given(st.text(max_size=30), st.text(max_size=60), st.text(max_size=30), st.text(max_size=30))
def test_any_request_without_the_token_is_refused(path, cookie, origin, host):
    headers = {"Host": host, "Origin": origin, "Cookie": cookie}
    assert HERE.refusal(f"/{path}", headers)
    assert HERE.refusal(f"/{path}", {"Host": "127.0.0.1:8080", "Cookie": cookie})


@pytest.mark.parametrize("origin", ["http://[", "null", "http://localhost:8081", "[", "://"])
def test_any_origin_but_its_own_is_refused(origin):
    headers = {"Host": "127.0.0.1:8080", "Origin": origin, "Cookie": COOKIE}
    assert HERE.refusal("/", headers) == f"a page of {origin!r} may not use this page"
    assert HERE.refusal("/", headers | {"Origin": "http://127.0.0.1:8080"}) == ""


@pytest.mark.parametrize("path", ["//[", "//[?a", "/?token=\udcff", "/?token=%ff"])
def test_any_path_is_checked(path):
    cookie = "minerva-8080=\udcff"
    assert "token" in HERE.refusal(path, {"Host": "localhost", "Cookie": cookie})
    assert HERE.refusal(path, {"Host": "localhost", "Cookie": COOKIE}) == ""


def test_a_server_that_only_reads_needs_no_token():
    reading = WebAccess("127.0.0.1", 9464)
    assert reading.refusal("/metrics", {"Host": "localhost:9464"}) == ""
    assert "not known as" in reading.refusal("/metrics", {"Host": "x"})
    assert "a page of" in reading.refusal("/", {"Host": "localhost", "Origin": "http://x"})
    foreign = WebAccess("127.0.0.1", 9464, origins=frozenset(("http://x",)))
    assert foreign.refusal("/", {"Host": "localhost", "Origin": "http://x"}) == ""


def test_a_token_is_also_accepted_in_a_header():
    given = {"Host": "localhost"}
    assert HERE.refusal("/", given | {"Authorization": "Bearer secret"}) == ""
    assert "token" in HERE.refusal("/", given | {"Authorization": "Bearer other"})


def test_viser_prints_nothing(tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    made = serve("127.0.0.1", 0)
    assert opened(url(made))[0] == 200
    stop(made)
    eventually(lambda: not made.thread.is_alive(), "the end")
    assert capfd.readouterr().out == ""


def test_broken_requests_leave_no_traceback(server, capfd):
    port = server.get_port()
    token = server.access.token
    for request in (
        "GET //[ HTTP/1.1\r\nHost: localhost\r\n\r\n",
        f"GET //[?token={token} HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\nOrigin: http://[\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\nCookie: a=\xff\r\n\r\n",
        "garbage\r\n\r\n",
    ):
        with socket.create_connection(("127.0.0.1", port)) as client:
            client.sendall(request.encode("latin-1"))
            assert b"200 OK" not in client.recv(100)
    for text in (b"GET", b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", port)) as client:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            client.sendall(text)
    assert opened(url(server))[0] == 200
    assert "Traceback" not in capfd.readouterr().err


def test_the_token_is_forgotten_when_the_world_has_ended(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    token = token_for(8080, "run")
    forget_token(8081)
    assert token_for(8080, "run") == token
    forget_token(8080)
    assert not list(tmp_path.iterdir())


def test_a_page_that_is_started_again_keeps_its_token(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "runtime"))
    assert token_for(8080) == token_for(8080) != token_for(8081)
    assert len(token_for(8080)) >= 20
    assert {path.stat().st_mode & 0o777 for path in (tmp_path / "runtime").iterdir()} == {0o600}


def test_without_a_folder_of_ones_own_the_token_is_new_each_time(tmp_path, monkeypatch):
    (tmp_path / "runtime").mkdir()
    (tmp_path / "runtime").chmod(0o777)
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "runtime"))
    assert token_for(8080) != token_for(8080)


def test_forged_messages_close_their_connection_and_change_nothing_else(server, capfd):
    slider = server.gui.add_slider("rate", 0.0, 10.0, 1.0, 5.0)
    uuid = slider._impl.uuid
    update = {"type": "GuiUpdateMessage", "uuid": uuid}
    closing = (
        b"",
        b"\xff",
        "text",
        packb(5),
        packb({"type": "RunMe"}),
        packb({"type": "ViewerCameraMessage"}),
        packb({**update, "updates": 5}),
        packb({**update, "updates": {"removed": True}}),
        packb({**update, "updates": {"value": 6.0, "update_cb": 5}}),
    )
    for data in closing:
        with page_of(server) as page:
            page.send(data)
            with pytest.raises(ConnectionClosed):
                list(page)
    with page_of(server) as page:
        for value in ("x", None, [], {}, 7.0):
            page.send(packb({**update, "updates": {"value": value}}))
        eventually(lambda: slider.value == 7.0, "the last value")
    assert not slider._impl.removed
    printed = capfd.readouterr().err
    assert "Traceback" not in printed
    assert "closed the connection of 127.0.0.1" in printed
    assert "ignored a message of a browser" in printed
    assert len(printed.splitlines()) == len(closing) + 4


@pytest.mark.parametrize(
    ("phase", "printed"), [("between frames", "http://here\n"), ("reports", "")]
)
def test_the_address_of_a_page_is_not_printed_after_the_end(capsys, phase, printed):
    operator = SimpleNamespace(status=lambda: SimpleNamespace(phase=phase))
    announce(SimpleNamespace(endpoint="tcp/127.0.0.1:1", operator=operator), "http://here")
    assert capsys.readouterr().out == printed
