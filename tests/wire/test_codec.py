"""Encoding followed by decoding preserves every message; numbers that are not finite are refused."""

import gc
import math
from functools import reduce

import hypothesis.strategies as st
import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from speaking import heard, readings, recorded, saved, scans, spoken

from minerva_bus import (
    Cells,
    Default,
    EventType,
    Generator,
    Metres,
    Primitive,
    Reals,
    Scene,
    Transformation,
    Vocabulary,
)
from minerva_bus.errors import ProtocolError, SceneError, VocabularyError
from minerva_bus.frame import messages as m
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.grammar.appearance import Disc, Motion
from minerva_bus.grammar.text_and_digest import same_values
from minerva_bus.testing.strategies import vocabularies, worlds
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.field_codecs import read_reading
from minerva_bus.wire.plain import COLLECTED, unpack
from minerva_bus.wire.status_codec import read_status
from minerva_bus.wire.vocabulary_codec import plain_kind, plain_vocabulary, read_vocabulary

PDot = Primitive("PDot", x=float)
TDeep = Transformation("TDeep")

law = settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))


def plain(vocabulary):
    return msgpack.packb(plain_vocabulary(vocabulary))


def values(scene):
    """All values of a string, in reading order."""
    return [value for node in scene for value in node.values]


@law
@given(spoken)
def test_member_messages_survive_a_round_trip(case):
    vocabulary, message = case
    assert Decoder(vocabulary).from_member(message.member, encode(message)) == message


@law
@given(heard)
def test_coordinator_messages_survive_a_round_trip(case):
    vocabulary, message = case
    back = Decoder(vocabulary).to_member(encode(message))
    if isinstance(message, m.Welcome):
        assert plain(back.vocabulary) == plain(vocabulary)
        assert (back.seed, back.dt, back.saved) == (message.seed, message.dt, message.saved)
    else:
        assert back == message


@law
@given(recorded)
def test_entries_survive_a_round_trip(case):
    vocabulary, record = case
    assert Decoder(vocabulary).record(encode(record)) == record


@law
@given(readings)
def test_readings_survive_a_round_trip(message):
    back = Decoder().readings(message.topic, message.member, encode(message))
    assert (back.member, back.topic, back.frame) == (message.member, message.topic, message.frame)
    assert encode(back) == encode(message)


@law
@given(scans)
def test_a_scan_that_has_travelled_is_read_only_and_of_the_same_numbers(scan):
    message = m.Readings("physics", "scan", 3, (scan,))
    (back,) = Decoder().readings("scan", "physics", encode(message)).readings
    assert back.ranges.dtype == np.float32
    assert back.ranges.tobytes() == scan.ranges.tobytes()
    assert not back.ranges.flags.writeable


@law
@given(worlds())
def test_a_string_that_has_travelled_is_in_canonical_form_and_of_the_same_digest(world):
    vocabulary, w = world
    sent = encode(m.Fragments({"a": w}))
    back = Decoder(vocabulary).to_member(sent).given["a"]
    assert back.digest == w.digest
    assert str(back) == str(w)
    assert same_values(tuple(values(back)), tuple(values(w)))
    assert vocabulary.check(back) is back


@law
@given(vocabularies())
def test_a_vocabulary_that_has_travelled_reads_the_same_strings(vocabulary):
    back = read_vocabulary(unpack(plain(vocabulary)))
    assert plain(back) == plain(vocabulary)
    for name, kind in vocabulary.kinds.items():
        assert plain_kind(back.kinds[name]) == plain_kind(kind)


@law
@given(st.data())
def test_equal_messages_are_equal_bytes(data):
    """This makes the bytes of runs comparable."""
    vocabulary, message = data.draw(spoken)
    again = Decoder(vocabulary).from_member(message.member, encode(message))
    assert encode(again) == encode(message)


@law
@given(saved)
def test_a_member_gets_its_saved_state_back(kept):
    message = m.TickReply("physics", 3, (), kept)
    assert Decoder().from_member("physics", encode(message)).saved == kept


def test_a_string_may_be_deep():
    w = Scene()
    for _ in range(20_000):
        w = TDeep()(w)
    vocabulary = Vocabulary.of(TDeep)
    back = Decoder(vocabulary).to_member(encode(m.Fragments({"a": w}))).given["a"]
    assert back.digest == w.digest


def test_a_string_may_be_wide():
    w = Scene(PDot(1.0).nodes * 100_000)
    back = Decoder(Vocabulary.of(PDot)).to_member(encode(m.Fragments({"a": w}))).given["a"]
    assert back == w


@pytest.mark.parametrize("array", [
    np.zeros((0, 0), np.int16), np.zeros((0, 5), np.int16), np.zeros((300, 200), np.int16),
    np.full((2, 2), -32768, np.int16), np.array([[1.5, -0.0], [5e-324, 1e308]]),
])  # fmt: skip
def test_matrices_of_every_shape(array):
    eMap = EventType("eMap", cells=Cells, heights=Reals)
    cells = array if array.dtype == np.int16 else np.zeros((1, 1), np.int16)
    heights = array if array.dtype == np.float64 else np.zeros((1, 1))
    message = m.Emitted("g", (eMap(cells, heights),))
    assert Decoder(Vocabulary.of(eMap)).from_member("g", encode(message)) == message


def test_a_matrix_that_is_no_row_order_travels_as_it_is():
    eMap = EventType("eMap", cells=Cells)
    turned = np.arange(6, dtype=np.int16).reshape(2, 3).T
    message = m.Emitted("g", (eMap(turned),))
    back = Decoder(Vocabulary.of(eMap)).from_member("g", encode(message))
    assert back.events[0].cells.tolist() == turned.tolist()


def test_the_key_names_the_sender():
    message = m.Emitted("liar", ())
    assert Decoder().from_member("honest", encode(message)).member == "honest"


def test_default_values_of_strings_travel_with_the_vocabulary():
    PBox = Primitive("PBox", size=Default(Metres, 1.5), label=Default(str, 'a "b"\n'))
    back = read_vocabulary(unpack(plain(Vocabulary.of(PBox, PDot))))
    assert str(back.read("PBox")) == str(PBox())


@pytest.mark.parametrize("wrong", [
    m.TickReply("g", 0, (), {"self": object()}),
    m.TickReply("g", 0, (), {"set": {1}}),
    m.TickReply("g", 0, (), {"text": "\ud800"}),
    m.TickReply("g", 0, (), {"deep": reduce(lambda inner, _: [inner], range(2000), [])}),
    m.Report("g", {"big": 1 << 70}),
])  # fmt: skip
def test_an_unencodable_message_is_the_senders_error(wrong):
    """Encoding a saved or reported value that is not plain raises an error of its own."""
    with pytest.raises(ProtocolError, match=f"a {type(wrong).__name__} cannot be sent: "):
        encode(wrong)


@pytest.mark.parametrize("text", ["lone \ud800", 3])
def test_a_large_message_that_is_rejected_leaves_garbage_collection_on(text):
    vocabulary = Vocabulary([EventType("eNear", text=str)])
    wrong = msgpack.packb(
        ["emitted", [["eNear", ["x"]]] * 9_000 + [["eNear", [text]]]],
        unicode_errors="surrogatepass",
    )
    assert len(wrong) > COLLECTED
    with pytest.raises((ProtocolError, VocabularyError)):
        Decoder(vocabulary).from_member("m", wrong)
    assert gc.isenabled()


ODD = (math.nan, math.inf, -math.inf)
ALL = EventType("eAll", x=Metres, some=tuple[float, ...], matrix=Reals, string=Scene)
DOTS = Primitive("PDot", size=float, shape=Disc(0.5))
VOCABULARY = Vocabulary.of(ALL, DOTS, Transformation("TAt", x=Metres, motion=Motion(x=0.5)))
DECODER = Decoder(VOCABULARY)


def column(*values):
    return msgpack.ExtType(3, b"d" + np.array(values, "<f8").tobytes())


MATRIX = msgpack.ExtType(1, b"r" + b"\x01\0\0\0\x02\0\0\0" + bytes(16))
DOT = [1, ["TAt", [1.0], 1], ["PDot", [0.5]]]
MANY = [1, [2, None, [["TAt", [column(1.0, 2.0)]], ["PDot", [column(0.5, 0.5)]]]]]
PATCH = ["patch", 2, ["TAt", "PDot"], [[0, 0, None, column(1.0, 2.0)]]]
EVENT = ["eAll", [1.0, [2.0, 3.0], MATRIX, msgpack.ExtType(2, msgpack.packb(DOT))]]
DRAWN = {"a": DOT, "b": MANY, "c": PATCH}
KIND = ["AFox", [["x", "real m", "0.5"]], [["eAll", 0.5]], [], ["x"]]
SPOKEN = {
    "hello": [{
        "version": PROTOCOL_VERSION, "kinds": [KIND], "generates": [], "when": "at 2.5 Hz",
        "orders": [], "draws": [], "coupled": False, "topics": [], "publishes": [],
        "about": {"service": "", "pid": 1, "host": "", "load": 2.5},
    }],
    "ticked": [1, [EVENT], None],
    "evolved": [1, 0, DRAWN, {"a": [EVENT]}, {"eAll": DRAWN}],
    "emitted": [[EVENT]],
    "doing": [{"mean": 0.5}],
    "report": [{"mean": 0.5}],
}  # fmt: skip
HEARD = {
    "welcome": ["w", {**plain_vocabulary(VOCABULARY), "kinds": [KIND]}, 7, 0.1, 0, "literal", None],
    "fragments": [{"a": DOT, "b": MANY}, []],
    "evolve": [1, [], [EVENT], [EVENT], 0, []],
    "view": ["eAll", 1, 0, DRAWN, DOT, ["a"]],
    "orders": [3, [EVENT]],
}
READINGS = [
    ["scan", "r", 0.5, bytes(8), 0.0, 1.0, 8.0, [0.0, 0.0, 0.0]],
    ["sightings", "r", 0.5, [["m", 1.0, 2.0]]],
    ["image", "r", 0.5, "mono8", 1, 1, b"\0", [0.0, 0.0, 0.0]],
    ["odometry", "r", 0.5, 1.0, 2.0, 3.0, 4.0, 5.0],
    ["battery", "r", 0.5, 0.5, 12.0],
    ["position", "r", 0.5, 1.0, 2.0, 3.0, 4.0],
]
CASES = [
    *((DECODER.to_member, [name, *items]) for name, items in HEARD.items()),
    *((lambda data: DECODER.from_member("a", data), [name, *items])
      for name, items in SPOKEN.items()),
    (lambda data: DECODER.readings("t", "a", data), ["readings", 1, READINGS]),
    (DECODER.record, ["frame", 1, [EVENT], {"a": DOT, "b": MANY}, b""]),
]  # fmt: skip


def spoilt(plain, odd):
    """Copies of the data, each with one of its numbers replaced by another."""
    if isinstance(plain, float):
        yield odd
    elif isinstance(plain, list):
        for place, value in enumerate(plain):
            for other in spoilt(value, odd):
                yield [*plain[:place], other, *plain[place + 1 :]]
    elif isinstance(plain, dict):
        for name, value in plain.items():
            for other in spoilt(value, odd):
                yield {**plain, name: other}
    elif isinstance(plain, msgpack.ExtType) and plain.code == 2:
        for other in spoilt(unpack(plain.data), odd):
            yield msgpack.ExtType(2, msgpack.packb(other))
    elif isinstance(plain, msgpack.ExtType):  # A matrix or a column: its last number.
        yield msgpack.ExtType(plain.code, plain.data[:-8] + np.float64(odd).tobytes())


@pytest.mark.parametrize(("read", "plain"), CASES, ids=[plain[0] for _, plain in CASES])
def test_a_message_with_a_number_that_is_none_is_refused(read, plain):
    assert read(msgpack.packb(plain))
    count = 0
    for odd in ODD:
        for damaged in spoilt(plain, odd):
            count += 1
            with pytest.raises((ProtocolError, SceneError)):
                read(msgpack.packb(damaged))
    assert count


@pytest.mark.parametrize("name", ["doing", "report"])
@pytest.mark.parametrize("odd", [*ODD, None, [1.0]])
def test_a_figure_is_a_finite_number_or_a_text(name, odd):
    with pytest.raises(ProtocolError, match="figures: mean must be a finite number or text"):
        DECODER.from_member("a", msgpack.packb([name, {"mean": odd}]))
    figures = {"mean": 0.5, "count": 1, "on": True, "how": "well"}
    assert DECODER.from_member("a", msgpack.packb([name, figures])).figures == figures


@pytest.mark.parametrize("odd", ODD)
def test_a_member_of_ours_leaves_out_what_is_none(odd):
    class Meter(Generator):
        def report(self):
            return {"count": 1, "mean": odd, "how": "well"}

    assert Member("meter", Meter()).figures() == {"count": 1, "how": "well"}


@pytest.mark.parametrize("odd", ODD)
def test_figures_are_as_finite_where_a_status_has_them(odd):
    member = {"name": "a", "state": "present", "figures": {"mean": odd}}
    with pytest.raises(ProtocolError, match="figures: mean must be a finite number"):
        read_status({"world": "w", "frame": 1, "members": [member]})


def test_a_range_is_a_number_and_as_far_as_one_likes():
    def scan(*ranges):
        return ["scan", "r", 0.5, np.array(ranges, "<f4").tobytes(), *READINGS[0][4:]]

    with pytest.raises(ProtocolError, match="not a number; 0 means that nothing was hit"):
        read_reading(scan(1.0, math.nan))
    assert read_reading(scan(1.0, math.inf, -1.0)).ranges.tolist() == [1.0, math.inf, -1.0]
