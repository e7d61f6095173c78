"""Assets at other members: who has a file, and what happens if it sends something else."""

import hashlib
from contextlib import ExitStack

import pytest

from minerva_bodies import assets
from minerva_bodies.assets import CHUNK, MAX_BYTES, AssetBus, answer_to, connect, read_asset
from minerva_bodies.errors import BodiesError
from minerva_bus import Vocabulary
from minerva_bus.runtime.session import Secured, listening_at, open_client, open_hub
from minerva_bus.security.access import access_control
from minerva_bus.wire.keys import Keys
from minerva_bus.wire.plain import pack, unpack
from minerva_bus.world.services import WorldInfo
from tests.patience import eventually

FILE, DATA = "parts/gear.stl", bytes(range(256)) * (CHUNK // 128)
DIGEST = hashlib.sha256(DATA).hexdigest()
KEYS = Keys("w")
BASE = f"{KEYS.base}/asset"


def info(member, session):
    return WorldInfo("w", Vocabulary.of(), 0, 0.1, session=(member, session))


@pytest.fixture(autouse=True)
def machine(tmp_path, monkeypatch):
    """A folder of files, and the folder of those that others have sent."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(assets, "_sources", [])
    monkeypatch.setattr(assets, "_PAUSES", (0.0,))
    (tmp_path / "parts").mkdir()
    return tmp_path


@pytest.fixture
def bus():
    """A hub; returns how to open sessions of its clients."""
    hub, endpoint = open_hub("hub")
    with hub, ExitStack() as stack:
        yield lambda name: stack.enter_context(open_client(name, endpoint))


def scripted(session, member, size, chunk):
    """A member that answers every question with this size, and these bytes for a place."""

    def answer(query):
        with query:
            _, _, *place = unpack(query.payload.to_bytes())
            data = chunk(*place) if place else pack(size)
            if data is not None:
                query.reply(f"{BASE}/{member}", data)

    return session.declare_queryable(f"{BASE}/{member}", answer)


def reached(source, *members):
    """Wait until the hub knows who answers: a declaration has no acknowledgement."""

    def known():
        asked = source._ask(f"{BASE}/*", [FILE, DIGEST])
        return {key.rpartition("/")[2] for key, _ in asked} >= {*members}

    eventually(known, f"{members} answer")


def honest(place):
    return DATA[place : place + CHUNK]


def test_a_member_that_joins_later_gets_the_file_in_chunks(machine, bus):
    (machine / FILE).write_bytes(DATA)
    connect(info("has", bus("has")))
    source = AssetBus(info("lacks", bus("lacks")))
    reached(source, "has")
    assert source.fetch(FILE, DIGEST[:16]) == (DATA, [])
    # It keeps the file, and can send it on.
    (machine / FILE).unlink()
    assert source.fetch("parts/other.stl", DIGEST)[0] == DATA
    assert unpack(answer_to(pack([FILE, DIGEST]))) == len(DATA)
    assert [path.name for path in (machine / "cache").rglob("*") if path.is_file()] == [DIGEST]


def test_another_member_answers_for_those_that_fail(machine, bus):
    others = bus("others")
    kept = [
        scripted(others, "a-dead", len(DATA), lambda place: DATA[:CHUNK] if not place else None),
        scripted(others, "b-liar", len(DATA), lambda place: bytes(len(honest(place)))),
        scripted(others, "c-huge", MAX_BYTES + 1, honest),
        scripted(others, "d-flood", len(DATA), lambda _: bytes(CHUNK + 1)),
        scripted(others, "e-mad", "size", honest),
    ]
    connect(info("lacks", bus("lacks")))
    (machine / FILE).write_bytes(b"old")
    reached(*assets._sources, "a-dead", "b-liar", "c-huge", "d-flood", "e-mad")
    with pytest.raises(BodiesError) as caught:
        read_asset("mesh 'gear'", f"{FILE}#sha256={DIGEST}")
    for problem in (f"{FILE} has another digest", f"a-dead has sent {CHUNK} of {len(DATA)} bytes",
                    "b-liar has sent other data", "c-huge has 67108865 bytes"):  # fmt: skip
        assert problem in str(caught.value)
    assert len(str(caught.value).splitlines()) <= 10
    kept.append(scripted(others, "f-good", len(DATA), honest))
    reached(*assets._sources, "f-good")
    assert read_asset("mesh 'gear'", f"{FILE}#sha256={DIGEST[:16]}") == (FILE, DATA)


@pytest.mark.parametrize(
    "question",
    [
        ["../gear.stl", DIGEST], ["/etc/passwd", DIGEST], ["link.stl", DIGEST], ["key.txt", DIGEST],
        [FILE, DIGEST[:8]], [FILE, "*" * 16], [FILE, "0" * 64], [FILE, DIGEST, -1], [FILE], 7,
    ],
)  # fmt: skip
def test_a_member_sends_only_assets_whose_digest_the_other_knows(machine, question):
    for path in (FILE, "key.txt", "../gear.stl"):
        (machine / path).write_bytes(DATA)
    (machine / "link.stl").symlink_to(machine.parent / "gear.stl")
    assert answer_to(pack([FILE, DIGEST]))
    assert answer_to(pack(question)) is None


def test_members_with_certificates_answer_in_their_own_names_only(machine):
    certificates = pytest.importorskip("minerva_certificates")
    folder = certificates.AuthorityFolder(machine / "keys")
    folder.init()
    for name in ("has", "lacks", "liar"):
        folder.issue(name, certificates.Wanted(("view",)))
    access = access_control(KEYS, folder.rights().values(), [])
    local = f"unixsock-stream/{machine}/hub.sock"
    secured = Secured(folder.credentials("coordinator"), local, access)
    hub, _ = open_hub("hub", "tls/127.0.0.1:0", secured=secured)
    (machine / FILE).write_bytes(DATA)
    with hub, ExitStack() as stack:
        sessions = {
            name: stack.enter_context(
                open_client(
                    name, listening_at(hub, "tls/127.0.0.1:0"), own=folder.credentials(name)
                )
            )
            for name in ("has", "lacks", "liar")
        }
        kept = scripted(sessions["liar"], "has", 3, lambda _: b"lie")
        connect(info("has", sessions["has"]))
        source = AssetBus(info("lacks", sessions["lacks"]))
        reached(source, "has")
        assert source.fetch(FILE, DIGEST) == (DATA, [])
        kept.undeclare()
