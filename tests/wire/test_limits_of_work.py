"""Excessive work is rejected before it is done, with the limit and a remedy."""

import sys

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import Agent, EventType, Vocabulary
from minerva_bus.errors import ProtocolError, VocabularyError
from minerva_bus.frame import messages as m
from minerva_bus.grammar.events import Events, in_columns, single
from minerva_bus.grammar.scene import DEPTH, AgentNode
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.plain import STRING, Limits, name_in, pack, unpack, values_in

eNear = EventType("eNear", distance=float)
eText = EventType("eText", text=str)
eBare = EventType("eBare")


class Stone(Agent, symbol="AStone"):
    """Has no attributes, so a row of it takes no byte."""


VOCABULARY = Vocabulary.of(eNear, eText, eBare, Stone)
SMALL = Limits(
    single_events=3, host_events=5, tick_bytes=800, emitted_bytes=900, receivers=4, conditions=39, kinds=2, fields=3, names=2, figures=2,
    events=50, rows=60, values=100, tick_values=200, answer_values=200, message_bytes=950, small_bytes=600,
)  # fmt: skip


def hello(**keys):
    fields = msgpack.unpackb(encode(m.Hello("x", 7)))[1] | keys
    return pack(["hello", fields])


def events(name, count, *rest):
    sent = [["eNear", [1.0 * n], *rest] for n in range(count)]
    return pack([name, sent] if name == "emitted" else [name, 7, sent, None])


def kind(name, fields=0):
    return [name, [[f"a{n}", "real", "0"] for n in range(fields)], [], [], []]


def many(count, ids=None):
    return ["eBare", count, [], "", None, ids]


TOO_MUCH = {
    "emitted": (events("emitted", 4), "emitted has 4 single events, over 3; send those of one type"),
    "ticked": (events("ticked", 4), "ticked has 4 single events, over 3; send those of one type"),
    "receivers": (
        pack(["emitted", [["eNear", [1.0], "", "", list("abcde")]]]),
        "emitted has 5 receivers of single events, over 4",
    ),
    "conditions": (
        pack(["emitted", [["eNear", [n], f"x < {n} and x < 100000", "", []] for n in (1.0, 2.0)]]),
        "emitted has 44 characters of conditions, over 39",
    ),
    "conditions of columns": (
        pack(["emitted", [["eBare", 1, [], c, None, None] for c in ("x < 1 and x < 100000", "x < 2 and x < 100000")]]),
        "emitted has 40 characters of conditions, over 39",
    ),
    "conditions of agents": (
        pack(["evolved", 0, 0, {}, {"a": [["eBare", [], f"x < {n} and x < {10**50}", "", []] for n in range(5)]}, {}]),
        "evolved has 325 characters of conditions, over 312",
    ),
    "columns": (pack(["emitted", [many(51)]]), "51 events at once, over 50"),
    "columns in all": (pack(["emitted", [many(30), many(30)]]), "60 events at once, over 50"),
    "emitted by agents": (
        pack(["evolved", 0, 0, {}, {"a": [many(30)], "b": [many(31)]}, {}]),
        "columns of more than 60 rows in a message",
    ),
    "single events by agents": (
        pack(["evolved", 0, 0, {}, {n: [["eBare", []]] * 3 for n in "ab"}, {}]),
        "evolved has 6 single events, over 5",
    ),
    "silent senders": (
        pack(["evolved", 0, 0, {}, {n: [] for n in "abcdef"}, {}]),
        "evolved has 6 senders of events, over 5",
    ),
    "bytes of a tick": (
        pack(["ticked", 0, [], {"x": bytes(900)}]), "ticked has .* bytes, over 800; raise tick_bytes in"
    ),
    "many bytes": (pack(["emitted", [["eText", ["x" * 900]]]]), "emitted has .* bytes, over 900"),
    "rows of fragments": (
        pack(["evolved", 0, 0, {n: [1, [30, [n, 0, 30], [["AStone", []]]]] for n in "abc"}, {}, {}]),
        "columns of more than 60 rows in a message",
    ),
    "rows of patches": (
        pack(["evolved", 0, 0, {n: ["patch", 31, ["AStone"], []] for n in "ab"}, {}, {}]),
        "columns of more than 60 rows in a message",
    ),
    "rows of newborn agents": (
        pack(["evolved", 0, 0, {"a": [1, [61, ["a", 0, 61], [["AStone", []]]]]}, {}, {}]),
        "columns of more than 60 rows in a message",
    ),
    "bytes of an answer": (
        pack(["evolved", 0, 0, {}, {"a": [["eText", ["x" * 950]]]}, {}]),
        "bytes at once, over 950",
    ),
    "values": (pack(["emitted", [["eText", [[0] * 200]]]]), "emitted has at least 101 values"),
    "answer": (pack(["ticked", 0, [], {"x": [0] * 200}]), "ticked has at least 201 values, over 200"),
    "doing": (pack(["doing", {"a": 1, "b": 2, "c": 3}]), "doing has 3 figures, over 2"),
    "report": (pack(["report", {"a": 1, "b": 2, "c": 3}]), "report has 3 figures, over 2"),
    "kinds": (hello(kinds=[kind("AX"), kind("AY"), kind("AZ")]), "hello has 3 kinds, over 2"),
    "attributes": (
        hello(kinds=[kind("AX", 2), kind("AY", 2)]), "hello has 4 attributes of kinds, over 3"
    ),
    **{
        f"names in {key}": (hello(**{key: ["a", "b", "c"]}), f"hello has 3 names in {key}, over 2")
        for key in ("generates", "orders", "draws", "topics", "publishes")
    },
    "a long hello": (hello(about={str(n): "x" * 100 for n in range(6)}), "hello has .* bytes, over 600"),
    "a long failure": (pack(["failed", 0, "x" * 600, ""]), "failed has .* bytes, over 600"),
    "no name": (b"\x91" * 700, "this is not a msgpack list that begins with a message's name"),
    "an unknown name": (pack(["hallo", "x" * 600]), "hallo has .* bytes, over 600"),
}  # fmt: skip


@pytest.mark.parametrize("what", TOO_MUCH)
def test_messages_over_a_limit_are_rejected(what):
    data, problem = TOO_MUCH[what]
    with pytest.raises(ProtocolError, match=problem):
        Decoder(VOCABULARY, SMALL).from_member("x", data)
    if what not in (
        "no name",
        "an unknown name",
        "values",
        "columns",
        "conditions",
        "conditions of columns",
    ):
        Decoder(VOCABULARY).from_member("x", data)


def test_values_nested_too_deep_do_not_affect_later_messages():
    decoder, value = Decoder(VOCABULARY), list[object]()
    for _ in range(DEPTH):
        value = [value]
    for _ in range(3):
        with pytest.raises(ProtocolError, match=f"nested more than {DEPTH} deep"):
            decoder.from_member("x", pack(["emitted", [["eText", [value]]]]))
        with pytest.raises(VocabularyError, match="text must be a text, not a list"):
            decoder.from_member("x", pack(["emitted", [["eText", value]]]))


def test_messages_at_a_limit_are_accepted():
    decoder = Decoder(VOCABULARY, SMALL)
    assert len(decoder.from_member("x", events("emitted", 3)).events) == 3
    assert len(decoder.from_member("x", pack(["doing", {"a": 1, "b": 2}])).figures) == 2
    for _ in range(3):  # Rows are counted per message.
        assert decoder.from_member("x", pack(["emitted", [many(50)]])).events[0].count == 50


STALLING = {
    "many events": lambda: events("emitted", 300_000),
    "different receivers": lambda: pack(["emitted", [["eNear", [0.0], "", "", [f"a{n}"]] for n in range(300_000)]]),
    "figures": lambda: pack(["doing", {str(n): n for n in range(200_000)}]),
    "kinds": lambda: hello(kinds=[[f"AX{n}", [], [], [], []] for n in range(200_000)]),
    "empty lists": lambda: pack(["emitted", [[]] * 2_000_000]),
    "rows of nothing": lambda: pack(["ticked", 0, [many(1_000_000, ["a", 0, 1_000_000])] * 5_000, None]),
    "deep": lambda: b"\x92\xa7emitted" + b"\x91" * 1_000_000,
}  # fmt: skip


@pytest.mark.parametrize("what", STALLING)
def test_expensive_messages_are_rejected_before_decoding(what, monkeypatch):
    """Each would take seconds and gigabytes; the limit applies before msgpack and the reader."""
    if what != "rows of nothing":  # For these the reader has to read the counts.
        monkeypatch.setattr("minerva_bus.wire.codec.unpack", lambda *_: pytest.fail("built"))
    monkeypatch.setattr("minerva_bus.wire.columns_codec.read_ids", lambda *_: pytest.fail("read"))
    with pytest.raises(ProtocolError):
        Decoder(VOCABULARY).from_member("x", STALLING[what]())


def test_as_many_honest_columns_as_before():
    whole = Events.repeated(eNear(1.0), 300_000)
    assert Decoder(VOCABULARY).from_member("x", encode(m.TickReply("x", 1, (whole,)))).events
    part = {"~a": [1, [1_000_000, ["a", 0, 1_000_000], [["AStone", []]]]]}
    sent = {"~a": [["eBare", 1_000_000, [], "", ["a", 0, 1_000_000], None]]}
    data = pack(["evolved", 0, 0, part, sent, {}])
    reply = Decoder(VOCABULARY).from_member("x", data)
    assert reply.emitted["~a"][0].count == 1_000_000


# --- counting ---

OTHER_EXTENSIONS = st.integers(0, 127).filter(lambda code: code != STRING)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | st.floats() | st.text()
    | st.binary(max_size=400) | st.builds(msgpack.ExtType, OTHER_EXTENSIONS, st.binary(max_size=300)),
    lambda inner: st.lists(inner, max_size=20) | st.dictionaries(st.text(), inner, max_size=5)
    | inner.map(lambda plain: msgpack.ExtType(STRING, pack(plain))),
    max_leaves=60,
)  # fmt: skip


def counted(plain):
    if isinstance(plain, list):
        return 1 + sum(map(counted, plain))
    if isinstance(plain, dict):
        return 1 + len(plain) + sum(map(counted, plain.values()))
    if isinstance(plain, msgpack.ExtType) and plain.code == STRING:
        return 1 + counted(msgpack.unpackb(plain.data, strict_map_key=False))
    return 1


@given(PLAIN, st.integers(0, 40))
def test_values_are_counted_as_msgpack_has_them(plain, most):
    assert values_in(pack(plain), sys.maxsize) == counted(plain)
    assert values_in(pack(plain), most) == min(counted(plain), most + 1)


@given(st.binary(max_size=20), st.integers(0, 30))
def test_no_content_of_a_string_hides_the_values_after_it(content, after):
    data = pack([msgpack.ExtType(STRING, content), *[None] * after])
    assert values_in(data, sys.maxsize) >= 2 + after


@given(st.binary(max_size=60))
def test_garbage_can_be_counted_and_has_a_name_or_none(data):
    assert values_in(data, 100) <= len(data)
    assert isinstance(name_in(data), str)


@given(st.sampled_from(["hello", "ticked", "x" * 40]), st.integers(1, 20))
def test_the_name_of_a_message_is_found(name, items):
    assert name_in(pack([name, *range(items)])) == name
    for head in (b"\xdc\x00\x02", b"\xdd\x00\x00\x00\x02"):
        assert name_in(head + bytes([0xD9, len(name)]) + name.encode() + b"\x01") == name


# --- compliance of members with the limits ---


@given(st.lists(st.sampled_from([eNear(1.0), eNear(2.0, receivers=["b"]), eBare(), eText("ä"),
                                 Events.repeated(eNear(3.0), 2)]), max_size=30))  # fmt: skip
def test_very_many_events_are_sent_in_columns(events):
    sent = tuple(events) * 60
    packed = in_columns(sent)
    for event_type in ("eNear", "eBare", "eText"):
        assert [event for event in single(packed) if event.type == event_type] == [
            event for event in single(sent) if event.type == event_type
        ]
    assert in_columns(sent[:1000]) == sent[:1000]


def test_a_generator_of_the_library_stays_within_the_limit():
    sent = in_columns(tuple(eNear(1.0 * n) for n in range(20_000)))
    assert Decoder(VOCABULARY).from_member("x", encode(m.TickReply("x", 0, sent)))
    assert len(sent) == 1


@given(st.lists(PLAIN, max_size=5), st.integers(0, 2000), st.binary(max_size=3))
def test_reading_in_slices_gives_the_same_message(plain, cut, more):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("minerva_bus.wire.plain.SLICE", 7)
        data = pack(plain)
        assert pack(unpack(data)) == data
        for wrong in (data[:cut], data + more):
            if wrong != data:
                with pytest.raises(ProtocolError, match="this is not msgpack"):
                    unpack(wrong)


def test_a_frame_has_the_events_of_all_members():
    """Each member may send as many as the limit allows; a host must not fail because of the sum."""
    batches = [
        Decoder(VOCABULARY, SMALL).from_member("m", pack(["emitted", [many(30)]])).events
    ] * 2
    request = encode(m.EvolveRequest(7, ("host",), (*batches[0], *batches[1])))
    assert sum(map(len, Decoder(VOCABULARY, SMALL).to_member(request).events)) == 60


LONG = "a" * 1025
TOO_LONG = {
    "an agent": pack(["evolved", 0, 0, {"a": [1, ["AStone", LONG, None, 0]]}, {}, {}]),
    "many agents": pack(["evolved", 0, 0, {"a": [9, *[["AStone", f"{n}{LONG}", None, 0] for n in range(9)]]}, {}, {}]),
    "a receiver": pack(["emitted", [["eBare", [], "", "", [LONG]]]]),
    "a sender": pack(["emitted", [["eBare", [], "", LONG, []]]]),
    "columns": pack(["evolved", 0, 0, {"~a": [1, [2, ["a" * 64, 0, 2], [["AStone", []]]]]}, {}, {}]),
    "receivers": pack(["emitted", [many(2, ["a" * 64, 0, 2])]]),
}  # fmt: skip


@pytest.mark.parametrize("what", TOO_LONG)
def test_ids_have_a_longest_one(what):
    """A search for many ids takes the memory of the longest for each of them."""
    with pytest.raises(
        ProtocolError, match=r"is not a valid agent id|ids of more than 64 characters"
    ):
        Decoder(VOCABULARY).from_member("x", TOO_LONG[what])


def test_agents_with_ids_too_long_for_columns_are_nodes():
    long = Stone.many("a" * 64, 40)
    checked = VOCABULARY.check(long)
    assert str(checked) == str(long)
    assert {type(piece) for piece in checked.pieces} == {AgentNode}
