"""The page as a device: its options, its port, its views, its end."""

import gzip
import importlib.util
import urllib.request
from unittest.mock import patch

import pytest
from web_world import FLOOR, WORDS, Nobody, PFloor, PStone, cart, slot, taken_port, yard

pytest.importorskip("viser")

from minerva_bus import MinervaError, View
from minerva_bus.frame import messages as m
from minerva_bus.frame.member_side import Member
from minerva_services.views.web import Web
from minerva_services.views.web.serving import serve, stop, url


@pytest.fixture
def page():
    made = Web()
    made.joined(yard())
    yield made
    made.close()


def test_it_prints_its_address_and_serves_the_page(page, capsys):
    where = url(page._server)
    assert where.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(where) as answer:
        assert answer.status == 200
        assert b"<html" in answer.read(500).lower()


@pytest.mark.parametrize("encoding", ["gzip", "identity"])
def test_the_title_of_the_page_is_the_name_of_the_world(page, encoding):
    request = urllib.request.Request(url(page._server), headers={"Accept-Encoding": encoding})
    with urllib.request.urlopen(request) as answer:
        content = answer.read()
        assert answer.headers["Content-Length"] == str(len(content))
    plain = gzip.decompress(content) if encoding == "gzip" else content
    assert b"<title>yard</title>" in plain


def test_the_line_that_is_printed_is_all_that_is_printed(capsys):
    page = Web()
    page.joined(yard())
    where = url(page._server)
    page.close()
    assert capsys.readouterr().out == f"{where}\n"


def test_two_pages_have_two_ports(page):
    other = Web()
    other.joined(yard())
    assert url(other._server) != url(page._server)
    other.close()


def test_a_port_that_is_in_use_is_one_line():
    taken, port = taken_port()
    with taken, pytest.raises(MinervaError, match=f"port {port} of 127.0.0.1 is in use") as refused:
        Web(port=port).joined(yard())
    assert "\n" not in str(refused.value)


def test_a_host_that_is_not_here_is_one_line():
    with pytest.raises(MinervaError, match=r"cannot listen at 192\.0\.2\.1"):
        serve("192.0.2.1", 0)


def test_a_port_may_be_chosen():
    taken, port = taken_port()
    taken.close()
    server = serve("127.0.0.1", port)
    assert url(server) == f"http://127.0.0.1:{port}/?token={server.access.token}"
    assert server.request_share_url() is None
    stop(server)


@pytest.mark.parametrize(
    "options",
    [{"port": 70000}, {"port": -1}, {"rate": 0.0}, {"rate": float("nan")}, {"draws": " , "}],
)
def test_options_that_cannot_be(options):
    with pytest.raises(MinervaError, match=r"^web: "):
        Web(**options)


@pytest.mark.parametrize("click", ["eNothing", "ePace", "eBring"])
def test_a_click_sends_an_event_type_with_one_text(click):
    page = Web(click=click)
    with pytest.raises(MinervaError, match="web: click is"):
        page.joined(yard())
    page.close()


def test_missing_viser_names_the_extra():
    def none(name, *rest):
        return None

    with (
        patch.object(importlib.util, "find_spec", none),
        pytest.raises(MinervaError, match=r"install .*'minerva-bus\[web\]'"),
    ):
        Web()


def test_views_lie_over_one_another_and_are_counted():
    page = Web(draws="ePicture, eShade")
    page.joined(yard(Nobody()))
    shown = []
    with patch.object(page._scene, "show", shown.append):
        page.show(View(0, "eShade", PStone(0.1)))
        page.show(View(0, "ePicture", PFloor(FLOOR) + slot("ACart", "c"), {"c": cart(1.0)}))
    assert [type(item).__name__ for item in shown[-1].items] == ["Tiles", "Discs", "Discs"]
    assert page._controller._receivers.agents == {"c": "ACart"}
    assert page.report()["page_views"] == 2
    page.close()


@pytest.mark.parametrize(
    ("messages", "reason"),
    [([], "this page has left the world"), ([m.Stop("frames done")], "the world has ended")],
)
def test_the_page_shows_why_it_closes(messages, reason):
    page = Web()
    member = Member("page", page)
    member.receive(m.Welcome("yard", WORDS, 1, 0.1, 0))
    # `minerva top` asks for metrics while the world continues.
    assert member.figures()["page_views"] == 0
    for message in messages:
        member.receive(message)
    with patch.object(page._panel, "end") as end:
        page.close()
    end.assert_called_once_with(reason)


def test_the_vocabulary_of_the_tests_is_whole():
    assert {"eGo", "ePace", "eBring"} <= set(WORDS.events)
