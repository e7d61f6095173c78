"""Arbitrary bytes: a message, ProtocolError or VocabularyError, in bounded memory and time."""

import struct
import tracemalloc
from contextlib import suppress

import hypothesis.strategies as st
import msgpack
import pytest
from hypothesis import HealthCheck, example, given, settings
from speaking import heard, plain_data, readings, recorded, spoken

from minerva_bus.errors import MinervaError, ProtocolError, SceneError, VocabularyError
from minerva_bus.frame import messages as m
from minerva_bus.frame.stimuli import Checkpoint, FrameInputs
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.entries import (
    EntryDecoder,
    Kept,
    decode_checkpoint,
    encode_checkpoint,
    encode_frame,
    encode_inputs,
    encode_keyframe,
)
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.keys import Keys, checked_name
from minerva_bus.wire.plain import Limits, unpack
from minerva_bus.wire.strings_codec import Reader
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary
from tests.family import FAMILY, FAMILY_VOCABULARY

law = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
few = settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
DECODER = Decoder(FAMILY_VOCABULARY)


def ways(decoder):
    """The four entry points of the decoder."""
    return (
        lambda data: decoder.from_member("m", data),
        decoder.to_member,
        lambda data: decoder.readings("scan", "m", data),
        decoder.record,
    )


def refused_or_read(data, decoder=DECODER):
    """Feed bytes to every entry point; only the two errors may be raised."""
    for way in ways(decoder):
        try:
            way(data)
        except (ProtocolError, SceneError) as error:
            assert len(str(error)) < 2000


NAMES = [
    "hello", "ticked", "evolved", "emitted", "failed", "resync", "leaving", "report", "greet",
    "welcome", "refused", "sources", "tick", "fragments", "evolve", "view", "orders", "repeat",
    "stop", "frame", "readings",
]  # fmt: skip
SYMBOLS = [*FAMILY_VOCABULARY.kinds, *FAMILY_VOCABULARY.primitives, *FAMILY_VOCABULARY.events,
           *FAMILY_VOCABULARY.transformations, "", "P", "A", "eNothing"]  # fmt: skip
odd = st.one_of(
    st.sampled_from(
        [float("nan"), float("inf"), -float("inf"), -1, 1 << 63, (1 << 64) - 1, -(1 << 63)]
    ),
    st.sampled_from(SYMBOLS),
    st.builds(msgpack.ExtType, st.integers(0, 127), st.binary(max_size=20)),
    st.builds(msgpack.ExtType, st.just(1), st.binary(min_size=9, max_size=40)),
    st.builds(lambda x: msgpack.ExtType(2, msgpack.packb(x)), plain_data()),
    st.just(msgpack.Timestamp(5)),
)
junk = plain_data(odd | st.none() | st.booleans() | st.integers(-5, 5) | st.text(max_size=5))
shaped = st.builds(
    lambda name, items: [name, *items], st.sampled_from(NAMES), st.lists(junk, max_size=8)
)


@law
@given(st.binary(max_size=200))
@example(b"")
@example(b"\xc1")
@example(b"\xdd\xff\xff\xff\xff")
@example(b"\xdf\xff\xff\xff\xff")
@example(b"\xc6\xff\xff\xff\xff")
def test_any_bytes(data):
    refused_or_read(data)


@law
@given(shaped)
def test_any_data_under_any_name(plain):
    refused_or_read(msgpack.packb(plain))


@law
@given(
    st.one_of(spoken, heard, recorded, readings.map(lambda r: (FAMILY_VOCABULARY, r))), st.data()
)
def test_valid_messages_with_some_bytes_changed(case, data):
    vocabulary, message = case
    broken = bytearray(encode(message))
    for _ in range(data.draw(st.integers(1, 4))):
        broken[data.draw(st.integers(0, len(broken) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(broken)) | st.just(len(broken)))
    refused_or_read(bytes(broken[:cut]), Decoder(vocabulary))


def replaced(plain, path, new):
    if not path:
        return new
    if isinstance(plain, list) and plain:
        place = path[0] % len(plain)
        return [replaced(x, path[1:], new) if i == place else x for i, x in enumerate(plain)]
    if isinstance(plain, dict) and plain:
        place = sorted(plain, key=str)[path[0] % len(plain)]
        return {k: replaced(v, path[1:], new) if k == place else v for k, v in plain.items()}
    if isinstance(plain, msgpack.ExtType) and plain.code == 2:
        return msgpack.ExtType(2, msgpack.packb(replaced(unpack(plain.data), path[1:], new)))
    return new


@law
@given(
    st.one_of(spoken, heard, recorded, readings.map(lambda r: (FAMILY_VOCABULARY, r))),
    st.lists(st.integers(0, 20), max_size=7),
    junk,
)
def test_valid_messages_with_one_part_replaced(case, path, new):
    vocabulary, message = case
    plain = replaced(unpack(encode(message)), path, new)
    refused_or_read(msgpack.packb(plain), Decoder(vocabulary))


def entries():
    """An entry of a log of each type, and its reader."""
    decoder, string = EntryDecoder(FAMILY_VOCABULARY), FAMILY[0]("w").string
    hits = (FAMILY_VOCABULARY.events["eHit"](amount=1.0),)
    reply = m.TickReply("rain", 3, hits, {"n": 1})
    evolved = m.EvolveReply("host", 3, 0)
    layout = ((("~w", 3),),)
    inputs = FrameInputs(
        3, ("eHit",), {"rain": reply}, {"wind": hits}, layout, [evolved], {"wind": hits}
    )
    kept = Kept.of(Checkpoint(3, {"rain": {"n": 1}}, hits, {"wind": hits}))
    view = m.ViewShown("eShow", 3, 0, {}, Scene(()))
    return {
        "inputs": (encode_inputs(inputs), decoder.inputs),
        "keyframe": (encode_keyframe(3, string, kept, [view]), decoder.keyframe),
        "checkpoint": (
            encode_checkpoint(kept, None),
            lambda data: decode_checkpoint(data, decoder.reader),
        ),
        "frame": (encode_frame(3, hits, [2, -1], bytes(16)), lambda data: decoder.frame(data, 0.0)),
    }


@pytest.mark.parametrize("name", entries())
@settings(max_examples=150, deadline=None)
@given(path=st.lists(st.integers(0, 20), max_size=4), new=junk)
@example(path=[8], new=[1])
@example(path=[3, 0], new=[])
@example(path=[5, 0, 0], new=7)
@example(path=[3], new=7)
def test_entries_of_a_log_with_one_part_replaced(name, path, new):
    data, read = entries()[name]
    read(data)
    with suppress(ProtocolError, SceneError):
        read(msgpack.packb(replaced(unpack(data), path, new)))


@few
@given(st.lists(st.integers(0, 12), max_size=7), junk)
def test_a_hello_with_one_part_replaced(path, new):
    hello = m.Hello("m", 1, kinds=tuple(kind.kind for kind in FAMILY), generates=("eHit",))
    refused_or_read(msgpack.packb(replaced(unpack(encode(hello)), [1, *path], new)))


@pytest.mark.parametrize("kind", [
    ["XBad", [], [], []],
    ["A", [["a b", "real", None]], [], []],
    ["A", [["a", "reel", None]], [], []],
    ["A", [["a", "real parsec", None]], [], []],
    ["A", [["a", "list of " * 100 + "int", None]], [], []],
    ["A", [["a", "real", "(("]], [], []],
    ["A", [["a", "int", '"x"']], [], []],
    ["A", [["a", "int", "1"], ["a", "int", "1"]], [], []],
    ["A", [], [], [3]],
    ["A", [], []],
])  # fmt: skip
def test_a_hello_with_a_wrong_kind_is_refused(kind):
    plain = unpack(encode(m.Hello("m", 1)))
    plain[1]["kinds"] = [kind]
    with pytest.raises(ProtocolError):
        DECODER.from_member("m", msgpack.packb(plain))
    vocabulary = {**plain_vocabulary(FAMILY_VOCABULARY), "kinds": [kind]}
    with pytest.raises(ProtocolError):
        read_vocabulary(vocabulary)


@few
@given(st.lists(st.integers(0, 12), max_size=7), junk)
def test_a_vocabulary_with_one_part_replaced(path, new):
    plain = replaced(plain_vocabulary(FAMILY_VOCABULARY), path, new)
    try:
        read_vocabulary(unpack(msgpack.packb(plain)))
    except ProtocolError:
        return


@few
@given(junk)
def test_any_value_for_any_datum(value):
    for name, declared in FAMILY_VOCABULARY.events.items():
        refused_or_read(msgpack.packb(["emitted", [[name, [value] * len(declared.fields.names)]]]))


@few
@given(junk, junk)
def test_any_state_for_an_agent(first, second):
    for state in ([first], [first, second], first):
        scene = [1, ["AWalker", "w", state, 0]]
        refused_or_read(msgpack.packb(["evolved", 0, 0, {"w": scene}, {}, {}]))
        refused_or_read(msgpack.packb(["view", "eShow", 0, 0, {"w": [1, ["PDot", state]]}, scene]))


# --- accepted data are complete --------------------------------------------------------------


def changed(scene):
    return DECODER.from_member("m", msgpack.packb(["evolved", 0, 0, {"w": scene}, {}, {}])).changed[
        "w"
    ]


@law
@given(st.one_of(shaped, st.builds(lambda s: ["evolved", 0, 0, {"w": s}, {}, {}], junk)))
def test_accepted_strings_conform_to_the_vocabulary(plain):
    try:
        message = DECODER.from_member("m", msgpack.packb(plain))
    except (ProtocolError, SceneError):
        return
    if isinstance(message, m.EvolveReply):
        for scene in message.changed.values():
            assert FAMILY_VOCABULARY.check(scene) == scene


@pytest.mark.parametrize(("scene", "problem"), [
    ([], "must begin with its count"),
    ([1], "cut off"),
    ([2, ["PGrave", []]], "cut off"),
    ([0, ["PGrave", []]], "has data after its end"),
    ([1, ["PGrave", []], ["PGrave", []]], "has data after its end"),
    ([-1], "whole number from 0"),
    ([True], "whole number from 0"),
    ([1, ["PGrave", [], 0]], "is not a symbol"),
    ([1, ["PGrave"]], "is not a symbol"),
    ([1, []], "a symbol must be text"),
    ([1, ["XGrave", []]], "is not a symbol"),
    ([1, ["PGhost", []]], "has no PGhost"),
    ([1, ["PDot", []]], "PDot has 0 values; expected 1"),
    ([1, ["PDot", ["wide"]]], "size must be a number"),
    ([1, ["PDot", [float("nan")]]], "a finite number"),
    ([1, ["PDot", [float("inf")]]], "a finite number"),
    ([1, ["PDot", [None]]], "cannot be nil"),
    ([1, ["PDot", [{}]]], "cannot be a map"),
    ([1, ["TShift", [1.0], 1]], "cut off"),
    ([1, ["TShift", [1.0], -1]], "whole number from 0"),
    ([1, ["TShift", [1.0], 1 << 40]], "cut off"),
    ([1, ["AWalker", "w", None, 0]], "must be a list, not nil"),
    ([1, ["AWalker", "", [0.0, 1.0], 0]], "not a valid agent id"),
    ([1, ["AWalker", "a b", [0.0, 1.0], 0]], "not a valid agent id"),
    ([1, ["AWalker", "w\n", [0.0, 1.0], 0]], "not a valid agent id"),
    ([1, ["AWalker", 7, [0.0, 1.0], 0]], "an id must be text"),
    ([1, ["AWalker", "w", [0.0], 0]], "AWalker#w has 1 values; expected 2"),
    ([1 << 63], "cut off"),
    ("AWalker#w", "must be a list"),
])  # fmt: skip
def test_an_invalid_string_is_rejected_with_its_error(scene, problem):
    with pytest.raises((ProtocolError, VocabularyError), match=problem):
        changed(scene)


@pytest.mark.parametrize(("event", "problem"), [
    (["eHit"], "must have 2, 5 or 6 items"),
    (["eHit", []], "eHit has 0 data; expected amount"),
    (["eHit", [1.0, 2.0]], "eHit has 2 data; expected amount"),
    (["eHit", ["hard"]], "amount must be a number"),
    (["eKick", [1.0]], "no event type 'eKick'"),
    ([7, [1.0]], "type must be text"),
    (["eHit", [1.0], "energy >", "", []], "condition"),
    (["eHit", [1.0], "__import__('os')", "", []], "condition"),
    (["eHit", [1.0], "", "", "ab"], "receivers must be a list"),
    (["eHit", [1.0], "", "", [1]], "an id must be text"),
    (["eHit", [1.0], 3, "", []], "a condition must be text"),
    ("eHit", "an event must be a list"),
])  # fmt: skip
def test_an_invalid_event_is_rejected_with_its_error(event, problem):
    with pytest.raises((ProtocolError, VocabularyError), match=problem):
        DECODER.from_member("m", msgpack.packb(["emitted", [event]]))


HEADER = struct.Struct("<cII")


@pytest.mark.parametrize(("data", "problem"), [
    (b"", "cut off"),
    (HEADER.pack(b"i", 1, 1), "has 0 bytes"),
    (HEADER.pack(b"i", 1 << 31, 1 << 31), "has 0 bytes"),
    (HEADER.pack(b"x", 0, 0), "of kind"),
    (HEADER.pack(b"r", 1, 1) + struct.pack("<d", float("nan")), "finite"),
    (HEADER.pack(b"r", 1, 1) + b"1234", "has 4 bytes"),
])  # fmt: skip
def test_a_wrong_matrix_is_refused(data, problem):
    from minerva_bus import EventType, Reals, Vocabulary

    decoder = Decoder(Vocabulary.of(EventType("eMap", heights=Reals)))
    with pytest.raises((ProtocolError, VocabularyError), match=problem):
        decoder.from_member("m", msgpack.packb(["emitted", [["eMap", [msgpack.ExtType(1, data)]]]]))


def test_two_agents_of_one_id_are_never_let_in():
    twins = [2, ["AMortal", "w", [1.0], 0], ["AMortal", "w", [1.0], 0]]
    nested = [1, ["AWalker", "w", [1.0, 1.0], 1], ["AMortal", "w", [1.0], 0]]
    for scene in (twins, nested):
        with pytest.raises((ProtocolError, VocabularyError), match="two agents have the id #w"):
            changed(scene)


# --- sizes -----------------------------------------------------------------------------------


def nested(depth, inner=b"\x90"):
    """Nested lists, as bytes."""
    return b"\x91" * depth + inner


@pytest.mark.parametrize("depth", [100, 300, 400, 500, 600, 900, 1000, 1023, 1024, 5000, 100_000])
def test_lists_in_lists(depth):
    for data in (
        nested(depth),
        b"\x92\xa7emitted\x91\x92\xa4eHit\x91" + nested(depth),
        b"\x92\xa6report\x81\xa1x" + nested(depth),
        b"\x94\xa6ticked\x00\x90\x81\xa1x" + nested(depth),
    ):
        refused_or_read(data)


def test_strings_in_strings():
    from minerva_bus import EventType, Primitive, Scene, Vocabulary

    decoder = Decoder(
        Vocabulary.of(Primitive("PBox", inside=Scene), EventType("eBox", inside=Scene))
    )
    scene = msgpack.packb([0])
    for _ in range(200):
        scene = msgpack.packb([1, ["PBox", [msgpack.ExtType(2, scene)]]])
    with pytest.raises((ProtocolError, VocabularyError), match="deep"):
        decoder.from_member(
            "m", msgpack.packb(["emitted", [["eBox", [msgpack.ExtType(2, scene)]]]])
        )


def test_sendable_values_have_a_text_form():
    """The protocol and the language have the same limit on nesting."""
    from minerva_bus import EventType, Primitive, Scene, Vocabulary

    vocabulary = Vocabulary.of(Primitive("PBox", inside=Scene), EventType("eBox", inside=Scene))
    decoder, depth, scene = Decoder(vocabulary), 0, [0]
    while True:
        packed = msgpack.packb(["fragments", {"a": scene}, []])
        try:
            back = decoder.to_member(packed).given["a"]
        except (ProtocolError, SceneError):
            break
        assert vocabulary.read(str(back)) == back
        depth += 1
        scene = [1, ["PBox", [msgpack.ExtType(2, msgpack.packb(scene))]]]
    assert depth >= 16


def test_limits_are_kept():
    tight = Limits(message_bytes=200, nodes=5, depth=3, events=2)
    decoder = Decoder(FAMILY_VOCABULARY, tight)
    grave = ["PGrave", []]

    def said(*items):
        return decoder.from_member("m", msgpack.packb(items))

    def deep(depth):
        return [1, *[["TShift", [1.0], 1]] * depth, grave]

    assert len(said("emitted", [["eGrow", []]] * 2).events) == 2
    with pytest.raises(ProtocolError, match="3 events at once, over 2"):
        said("emitted", [["eGrow", []]] * 3)
    assert said("evolved", 0, 0, {"w": [4, *[grave] * 4]}, {}, {})
    with pytest.raises(ProtocolError, match="a string of 6 symbols, over 5"):
        said("evolved", 0, 0, {"w": [5, *[grave] * 5]}, {}, {})
    assert said("evolved", 0, 0, {"w": deep(2)}, {}, {})
    with pytest.raises(ProtocolError, match="nested more than 3 deep"):
        said("evolved", 0, 0, {"w": deep(3)}, {}, {})
    with pytest.raises(ProtocolError, match="bytes at once, over 200"):
        said("failed", 0, "x" * 300, "")


@pytest.mark.parametrize("data", [
    b"\xdd\x00\x00\xff\xff" + b"\x90" * 0xFFFF,
    b"\xdd\x00\x00\xff\xff" + b"\xc0" * 0xFFFF,
    b"\x92\xa7emitted\xdd\x00\x00\xff\xff" + b"\x90" * 0xFFFF,
    b"\x92\xa6report\xdf\x7f\xff\xff\xff" + b"\xa1a\x01" * 1000,
    b"\xdb\x7f\xff\xff\xff" + b"a" * 1000,
    b"\xc9\x7f\xff\xff\xff\x02" + b"a" * 1000,
    msgpack.packb(["evolved", 0, 0, {"w": [1 << 60]}, {}, {}]),
    msgpack.packb(["emitted", [["eMark", [msgpack.ExtType(1, HEADER.pack(b"r", 1 << 31, 1 << 31))]]]]),
])  # fmt: skip
def test_memory_is_bounded_by_what_was_really_sent(data):
    tracemalloc.start()
    try:
        refused_or_read(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 100 * len(data) + 1_000_000


def test_a_message_over_the_limit_is_refused_before_it_is_read():
    data = msgpack.packb(["failed", 0, "x" * (100 << 20), ""])
    tracemalloc.start()
    with pytest.raises(ProtocolError, match=f"{len(data)} bytes at once, over 67108864"):
        DECODER.from_member("m", data)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1_000_000


def test_an_unknown_message_is_named_and_the_known_ones_are():
    with pytest.raises(
        ProtocolError, match="no message 'hallo' is sent here; expected hello, ticked"
    ):
        DECODER.from_member("m", msgpack.packb(["hallo"]))
    with pytest.raises(ProtocolError, match="no message 'hello' is sent here; expected greet"):
        DECODER.to_member(encode(m.Hello("m", 1)))
    with pytest.raises(ProtocolError, match="tick has 1 items, not 2"):
        DECODER.to_member(msgpack.packb(["tick", 0, 0]))


def test_a_foreign_vocabulary_is_named():
    from minerva_bus import EventType, Primitive, Vocabulary

    foreign = Decoder(
        Vocabulary.of(Primitive("PDott", size=float), EventType("eHitt", amount=float))
    )
    with pytest.raises(VocabularyError, match=r"no PDot; did you mean 'PDott'"):
        foreign.from_member(
            "m", msgpack.packb(["evolved", 0, 0, {"w": [1, ["PDot", [1.0]]]}, {}, {}])
        )
    with pytest.raises(VocabularyError, match="no event type 'eHit'"):
        foreign.from_member("m", msgpack.packb(["emitted", [["eHit", [1.0]]]]))


def test_long_names_do_not_make_long_errors():
    long = "P" + "x" * 1_000_000
    refused_or_read(msgpack.packb(["evolved", 0, 0, {"w": [1, [long, []]]}, {}, {}]))
    refused_or_read(msgpack.packb(["emitted", [[long, []]]]))
    refused_or_read(msgpack.packb([long]))
    refused_or_read(msgpack.packb(["report", {long: []}]))
    refused_or_read(msgpack.packb(["hello", {long: 1}]))
    refused_or_read(msgpack.packb(["evolved", 0, 0, {"w": [1, ["AWalker", long, [], 0]]}, {}, {}]))
    refused_or_read(msgpack.packb(["emitted", [["eHit", [long]]]]))
    refused_or_read(msgpack.packb(["emitted", [["eHit", [1.0], long, "", []]]]))


def test_reading_goes_on_after_an_error():
    reader = Reader(FAMILY_VOCABULARY)
    inner = msgpack.ExtType(2, msgpack.packb([1, ["PGhost", []]]))
    for _ in range(100):
        with pytest.raises(MinervaError):
            reader.value(inner)
    assert reader.value(msgpack.ExtType(2, msgpack.packb([1, ["PGrave", []]]))) is not None


@law
@given(st.text(max_size=80))
def test_names_that_do_not_fit_into_a_key_are_refused(name):
    try:
        checked_name(name, "a member")
    except MinervaError:
        return
    assert Keys("w").to(name) == f"minerva/w/to/{name}"
    assert not set(name) & set("/*$?# \n")


# --- ids, columns, patches and deltas: valid form with an invalid byte, length or offset ---

few_rows = st.integers(0, 3)
arrays = st.builds(
    lambda letter, data: msgpack.ExtType(3, letter + data),
    st.sampled_from([b"d", b"b", b"h", b"i", b"q", b"?", b"x", b""]),
    st.one_of(st.binary(max_size=24), st.lists(st.integers(0, 3), max_size=4).map(bytes)),
)
spelled_ids = st.builds(
    lambda width, names: [
        None,
        width,
        b"".join(name[:width].ljust(width, b"\0") for name in names),
    ],
    st.integers(0, 5),
    st.lists(
        st.one_of(st.binary(max_size=5), st.sampled_from([b"a", b"b1", b"\xcf", b"\xff\n"])),
        max_size=3,
    ),
)
numbered_ids = st.one_of(
    st.builds(list, st.tuples(st.text(max_size=3), arrays)),
    st.builds(
        list,
        st.tuples(st.text(max_size=3), st.integers(-1, (1 << 64) - 1), st.integers(-1, 1 << 40)),
    ),
)
many_ids = st.one_of(st.none(), spelled_ids, numbered_ids, junk)
fields = st.one_of(arrays, many_ids, st.lists(st.text(max_size=4), max_size=3), junk)
batches = st.builds(
    list,
    st.tuples(
        st.sampled_from(SYMBOLS), few_rows, st.lists(fields, max_size=3), st.sampled_from(["", "x > 1", "("]),
        many_ids, many_ids,
    ),
)  # fmt: skip
populations = st.builds(
    list,
    st.tuples(few_rows, many_ids, st.lists(st.tuples(st.sampled_from(SYMBOLS), st.lists(fields, max_size=3)).map(list), max_size=2)),
)  # fmt: skip
deltas = st.builds(
    lambda count, symbols, changes, more: ["patch", count, symbols, changes, *more],
    few_rows,
    st.lists(st.sampled_from(SYMBOLS), max_size=2),
    st.lists(st.tuples(st.integers(-1, 2), st.integers(-1, 3), st.none() | arrays, fields).map(list), max_size=2),
    st.one_of(st.just(()), st.tuples(arrays, arrays, many_ids)),
)  # fmt: skip
columnar = st.one_of(
    st.builds(lambda events: ["emitted", events], st.lists(batches, max_size=2)),
    st.builds(lambda scene: ["evolved", 0, 0, {"w": scene}, {}, {}], st.one_of(populations.map(lambda p: [p]), deltas)),
    st.builds(lambda events: ["evolved", 0, 0, {}, {}, {"w": events}], st.lists(batches, max_size=2)),
    st.builds(lambda scene: ["fragments", {"w": scene}, []], st.one_of(populations.map(lambda p: [p]), deltas)),
    st.builds(lambda parts, skeleton: ["view", "eShow", 0, 0, {"w": parts}, skeleton], st.one_of(populations.map(lambda p: [p]), deltas), st.none() | junk),
    st.builds(lambda events: ["evolve", 0, [], events, [], {}, []], st.lists(batches, max_size=2)),
)  # fmt: skip


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(columnar)
@example(["emitted", [["eSaw", 1, [], "", None, [None, 1, b"\xcf"]]]])
@example(["emitted", [["eSaw", 1, [], "", [None, 1, b"\xcf"], None]]])
@example(["evolved", 0, 0, {"w": [[1, [None, 1, b"\xcf"], [["AFox", []]]]]}, {}, {}])
def test_columns_and_deltas_of_any_content(plain):
    refused_or_read(msgpack.packb(plain))


@pytest.mark.parametrize("data", [b"\xcf", b"a\xcfb", b"\n", b"\0", b" "])
def test_bytes_that_are_no_id_are_named(data):
    plain = [
        "emitted",
        [[next(iter(FAMILY_VOCABULARY.events)), 1, [], "", None, [None, len(data), data]]],
    ]
    with pytest.raises(ProtocolError, match="is not a valid agent id"):
        DECODER.from_member("m", msgpack.packb(plain))


def test_a_defect_of_a_reader_is_the_senders_violation(monkeypatch):
    from minerva_bus.grammar.events import Event

    monkeypatch.setattr(Reader, "events", lambda *_: 1 / 0)
    with pytest.raises(ProtocolError, match="cannot be decoded: ZeroDivisionError"):
        DECODER.from_member("m", encode(m.Emitted("m", (Event("eTick"),))))
