"""What a page may send to the bus, which names it may take, and which files it gets."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import given

from minerva_bus.errors import MisuseError
from minerva_services.views.page.guard import BusGuard, ForbiddenMessage
from minerva_services.views.page.names import PageNames, read_joins
from minerva_services.views.page.relay import check_relayed
from minerva_services.views.page.service import MemberPage
from minerva_services.views.page.site import PageSite
from minerva_services.views.palette import person_colour

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "protocol" / "zenoh-wire.md"
PROTOCOL = PAGE.read_text(encoding="utf-8")
WIRE = ROOT / "members" / "javascript" / "src" / "wire.js"


def documented():
    """The examples of Zenoh's messages in docs/reference/protocol/zenoh-wire.md, by title."""
    blocks = re.findall(r"^```hex zenoh\n# (.*?)\n(.*?)^```$", PROTOCOL, re.S | re.M)
    return {
        title: bytes.fromhex("".join(re.split(r"\s{2,}", line.strip())[0] for line in body.splitlines()))
        for title, body in blocks
    }  # fmt: skip


EXAMPLES = documented()


def framed(*messages):
    return bytes([0x25, 0, *b"".join(messages)])


def key(text):
    return bytes([0, len(text), *text.encode()])


def put(where, payload=b"x", quality=b"\x21\x0d"):
    return bytes([0xBD, *key(where), *quality, 0x01, len(payload), *payload])


def subscriber(where):
    return bytes([0x1E, 0x22, 1, *key(where)])


def token(where):
    return bytes([0x1E, 0x26, 1, *key(where)])


@pytest.mark.parametrize("title", EXAMPLES)
def test_the_messages_of_the_document_pass(title):
    BusGuard("w", "rain").check(EXAMPLES[title])


@pytest.mark.parametrize(
    "title", [title for title in EXAMPLES if "minerva" in str(EXAMPLES[title])]
)
def test_they_are_those_of_one_name(title):
    shared = {"subscriber", "interest"}  # `all` and the coordinator's token are for every member
    guard = BusGuard("w", "sun")
    if title in shared:
        guard.check(EXAMPLES[title])
    else:
        with pytest.raises(ForbiddenMessage):
            guard.check(EXAMPLES[title])


@pytest.mark.parametrize(
    "message",
    [
        put("minerva/w/from/rain"),
        put("minerva/w/topic/scan/rain"),
        subscriber("minerva/w/to/rain"),
        subscriber("minerva/w/evolve"),
        subscriber("minerva/w/view/ePicture"),
        subscriber("minerva/w/topic/scan/*"),
        token("minerva/w/alive/rain"),
    ],
)
def test_a_member_may(message):
    BusGuard("w", "rain").check(framed(message, message))


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (put("minerva/w/from/sun"), "publish"),
        (put("minerva/w/from/rain/more"), "publish"),
        (put("minerva/w/from/*"), "publish"),
        (put("minerva/w/evolve"), "publish"),
        (put("minerva/other/from/rain"), "publish"),
        (put("minerva/w/topic/*/rain"), "publish"),
        (put("minerva/w/control"), "publish"),
        (subscriber("minerva/w/to/sun"), "declare"),
        (subscriber("minerva/w/to/*"), "declare"),
        (subscriber("minerva/w/from/sun"), "declare"),
        (subscriber("minerva/w/**"), "declare"),
        (subscriber("**"), "declare"),
        (subscriber("minerva/w/record"), "declare"),
        (token("minerva/w/alive/sun"), "declare"),
        (token("minerva/w/alive/coordinator"), "declare"),
        (token("minerva/w/epoch/9"), "declare"),
        (bytes([0x1E, 0x24, 1, *key("minerva/w/control")]), "declare"),  # a queryable
        (bytes([0x1E, 0x20, 1, *key("minerva/w/from/sun")]), "declare"),  # a mapping
        (bytes([0x39, 1, 0x39, *key("minerva/w/alive/*")]), "tokens"),
        (bytes([0x39, 1, 0x3F, *key("minerva/w/alive/rain")]), "tokens"),
        (bytes([0xBC, *key("minerva/w/control")]), "0xbc"),  # a query
        (bytes([0x1D, 5]), "0x1d"),  # a put on a mapping
        (put("minerva/w/from/rain", quality=b"\x22\x01x"), "extensions"),
        (put("minerva/w/from/rain")[:-1], "cut off"),
        (b"\xbd\x05\x01a", "mapping"),
        (b"\xbd\x00\x01\xff\x21\x0d\x01\x00", "UTF-8"),
        (b"\xbd" + b"\x80" * 10, "too long"),
    ],
)
def test_a_member_may_not(message, reason):
    guard = BusGuard("w", "rain")
    with pytest.raises(ForbiddenMessage, match=reason):
        guard.check(framed(message))
    with pytest.raises(ForbiddenMessage, match=reason):
        guard.check(framed(put("minerva/w/from/rain"), message))
    with pytest.raises(ForbiddenMessage, match=reason):
        guard.check(bytes([0x04, *framed(message)]))


@pytest.mark.parametrize("batch", [b"", b"\x1f", b"\x41\x09\x30", b"\x45\x00", b"\xc1\x09\x32"])
def test_other_batches_are_refused(batch):
    with pytest.raises(ForbiddenMessage):
        BusGuard("w", "rain").check(batch)


def test_fragments_are_checked_by_the_first():
    guard = BusGuard("w", "rain")
    whole = put("minerva/w/from/rain", b"y" * 100)
    for _ in range(2):
        guard.check(bytes([0x66, 0, *whole[:50]]))
        guard.check(bytes([0x66, 1, *whole[50:60]]))
        guard.check(bytes([0x26, 2, *whole[60:]]))
    with pytest.raises(ForbiddenMessage, match="publish"):
        guard.check(bytes([0x66, 3, *put("minerva/w/from/sun", b"y" * 100)[:50]]))


@given(st.binary(max_size=100))
def test_bytes_never_raise_anything_else(batch):
    for data in (batch, framed(batch), bytes([0x66, 0, *batch])):
        guard = BusGuard("w", "rain")
        try:
            guard.check(data)
        except ForbiddenMessage as forbidden:
            assert len(str(forbidden)) < 1000


def test_pages_have_numbers_and_hold_names():
    names = PageNames("page", read_joins("snails, tilt-*"))
    with names.page() as first, names.page() as second:
        assert (first, second) == (1, 2)
        assert names.joins_of(second) == {"snails": "snails", "tilt-*": "tilt-2"}
        with names.held("snails"):
            assert names.objection("snails") == "snails takes part in another page"
            assert names.taken == ["snails"]
        assert (
            names.objection("snails")
            == names.objection("tilt-2")
            == names.objection("page-1")
            == ""
        )
    with names.page() as again:
        assert again == 1


@pytest.mark.parametrize("name", ["", "coordinator", "sky", "page", "page-", "page-x", "page-01", "snails-1", "tilt-*", "page-1\n", "snails2"])  # fmt: skip
def test_pages_take_no_other_names(name):
    assert "may not take part" in PageNames("page", ("snails", "tilt-*")).objection(name)


@pytest.mark.parametrize("joins", ["a/b", "*", "tilt*", "ti-*-lt", "é"])
def test_names_that_no_member_has_are_refused(joins):
    with pytest.raises(MisuseError, match="joins"):
        read_joins(joins)


def test_a_site_has_three_folders_and_no_other(tmp_path):
    (tmp_path / "keys.pem").write_text("secret")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "garden.js").write_text("export default {};")
    (tmp_path / "sub" / "secret.toml").write_text("secret")
    (tmp_path / "outside.js").write_text("outside")
    site = PageSite(tmp_path / "sub" / "garden.js")
    assert site.module == "/modules/garden.js"
    for path in ("/", "/page.js", "/canvas.js", "/minerva/index.js", "/modules/garden.js"):
        assert site.file(path) is not None, path
    for path in (
        *("/modules/secret.toml", "/modules/../outside.js", "/modules/..%2foutside.js", "/modules/"),
        *("/service.py", "/../service.py", "//etc/passwd", "/minerva/../package.json", "/.js", "/nothing.js"),
        "/modules/sub/garden.js",
    ):  # fmt: skip
        assert site.file(path) is None, path


def test_the_page_loads_nothing_from_elsewhere():
    site = PageSite(None)
    page = site.file("/").content.decode()
    assert "sha256-" in site.policy
    assert re.findall(r'(?:src|href)="([^"]*)"', page) == ["data:,", "/page.css", "/page.js"]
    folder = ROOT / "services" / "minerva_services" / "views" / "page" / "static"
    for path in folder.iterdir():
        assert site.file(f"/{path.name}") is not None
        assert not re.search(r"https?://", path.read_text(encoding="utf-8")), path


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"port": 70000}, "port is 70000"),
        ({"rate": 0}, "rate is 0"),
        ({"draws": ""}, "draws"),
        ({"joins": "snails"}, "go together"),
        ({"module": "garden.js"}, "go together"),
        ({"module": "garden.txt", "joins": "snails"}, "not a file with JavaScript"),
        ({"certificate": "/nothing.pem"}, "cannot be used"),
        (
            {"beside": "nothing.mcap"},
            "beside is the record of another run: .*nothing.mcap: No such",
        ),
        ({"beside": __file__}, "not an MCAP file; expected a record"),
    ],
)
def test_options_are_checked(options, reason):
    with pytest.raises(MisuseError, match=reason):
        MemberPage(**options)


@pytest.mark.parametrize("endpoint", ["", "tls/lab.example:7447", "quic/lab.example:7447"])
def test_pages_join_on_the_machine_of_the_world(endpoint):
    with pytest.raises(MisuseError, match="page: "):
        check_relayed(endpoint)


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_the_package_sends_nothing_that_is_refused():
    """Every writer of wire.js, and a payload in fragments."""
    script = f"""
      import * as wire from {json.dumps(WIRE.as_uri())};
      const framed = (message) => wire.batches(message, 1 << 27, 65535);
      const batches = [
        wire.init(new Uint8Array(16), 65535), wire.open(3, 200, new Uint8Array(200)), wire.keepAlive(), wire.close(),
        ...framed(wire.put("minerva/w/from/rain", new Uint8Array(200000))),
        ...framed(wire.declareSubscriber(300, "minerva/w/tick")), ...framed(wire.declareToken(7, "minerva/w/alive/rain")),
        ...framed(wire.interestInTokens(8, "minerva/w/alive/rain", false)),
        ...framed(wire.interestInTokens(9, "minerva/w/alive/coordinator", true)), ...framed(wire.undeclareToken(7)),
      ];
      console.log(JSON.stringify(batches.map((batch) => Buffer.from(batch).toString("hex"))));
    """
    done = subprocess.run(
        ["node", "--input-type=module", "-e", script], capture_output=True, text=True, check=True
    )
    batches = json.loads(done.stdout)
    assert len(batches) == 13
    guard = BusGuard("w", "rain")
    for batch in batches:
        guard.check(bytes.fromhex(batch))


def test_people_choose_names_that_no_other_page_or_person_has():
    names = PageNames("page", ("snails",))
    with names.page() as first, names.page() as second:
        assert names.people == ["page-1", "page-2"]
        names.choose(first, "anna")
        assert names.person(first) == "anna"
        for name in ("anna", "page-1", "page-7", "snails"):
            with pytest.raises(MisuseError, match="choose another one"):
                names.choose(second, name)
        with pytest.raises(MisuseError, match="cannot name a person"):
            names.choose(second, "a/b")
        names.choose(second, "bert")
        names.choose(first, "")
        assert names.people == ["bert", "page-1"]
    assert names.people == []


def test_the_colour_of_a_person_follows_from_the_name():
    assert person_colour("web/anna") == person_colour("anna") != person_colour("bert")
