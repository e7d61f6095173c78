"""Messages are declared once: encoder, decoder, limits and table row are derived."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, make_dataclass
from typing import Annotated, Any, ClassVar

import pytest

from minerva_bus import EventType, Vocabulary
from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.messages import AtLeast, AtMost, Mark, Note, Wire
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.codec import Decoder, by_name, encode, message_codec
from minerva_bus.wire.plain import Limits, pack, unpack
from tools.protocol_tables import messages

eNear = EventType("eNear", distance=float)


@dataclass(frozen=True, slots=True)
class Probe:
    """A message for this test only."""

    WIRE: ClassVar = Wire("probe", ("from",), "for a test")

    member: m.Sender
    count: Annotated[int, AtLeast(3), Note("how many")]
    names: Annotated[tuple[str, ...], AtMost("names")]
    rate: Annotated[float, AtLeast(0)] = 1.0
    events: m.GeneratedEvents = ()
    saved: m.Saved = None
    by_topic: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    seen: Annotated[float, Mark.LOCAL] = 0.0


PROBE = Probe("x", 3, ("a", "b"), 0.5, (eNear(1.0),), {"k": None}, {"t": ("a",)})
PLAIN: list[Any] = [
    "probe", 3, ["a", "b"], 0.5, [["eNear", [1.0]]], {"k": None}, {"t": ["a"]}
]  # fmt: skip
DECODER = Decoder(Vocabulary.of(eNear), Limits(names=2, single_events=1))


def decoded(plain):
    return DECODER.decode(by_name([Probe]), ("x",), pack(plain), limited=True)


def test_a_declared_message_goes_through_the_codec():
    assert unpack(encode(PROBE)) == PLAIN
    assert decoded(PLAIN) == PROBE
    assert decoded(["probe", 3, [], 0, [], None, {}]) == Probe("x", 3, (), 0.0)


@pytest.mark.parametrize(("place", "value", "problem"), [
    (1, 2, "probe: count must be a whole number from 3, not 2"),
    (1, True, "probe: count must be a whole number from 3, not True"),
    (1, "3", "probe: count must be a whole number from 3, not text"),
    (2, ["a", 1], "probe: names must be text, not 1"),
    (2, ["a", "b", "c"], "probe has 3 names, over 2"),
    (2, "a", "probe: names must be a list, not text"),
    (3, -0.5, "probe: rate must be a number from 0, not -0.5"),
    (3, float("nan"), "probe: rate must be a finite number, not nan"),
    (4, [["eNear", [1.0]]] * 2, "probe has 2 single events, over 1; send those of one type"),
    (4, [["eNear"]], "probe: events: an event must have 2, 5 or 6 items, not 1"),
    (5, [], "probe: saved must be a map with text keys, not a list"),
    (6, {"t": [None]}, "probe: by_topic must be text, not nil"),
])  # fmt: skip
def test_its_limits_are_kept_and_the_error_names_message_and_field(place, value, problem):
    plain = [*PLAIN]
    plain[place] = value
    with pytest.raises(ProtocolError, match=f"^{re.escape(problem)}"):
        decoded(plain)


def test_its_number_of_items_is_checked():
    for plain in (PLAIN[:-1], [*PLAIN, 0]):
        with pytest.raises(ProtocolError, match=f"probe has 6 items, not {len(plain) - 1}"):
            decoded(plain)


def test_its_row_in_the_document_follows():
    row = messages(by_name([Probe]), "on").splitlines()[-1]
    assert row.startswith("| `probe` | 6 | `from` | `count` int from 3 (how many), `names` [text],")
    assert row.endswith("| for a test |")


def test_a_new_key_of_a_hello_is_declared_in_one_place():
    @fast_dataclass
    class Hello(m.Hello):
        WIRE: ClassVar = m.Hello.WIRE
        region: Annotated[str, Mark.OPTIONAL, Note("where it is")] = "here"

    codecs, hello = by_name([Hello]), Hello("x", 7, region="there")
    assert unpack(encode(hello))[1] == unpack(encode(m.Hello("x", 7)))[1] | {"region": "there"}
    assert DECODER.decode(codecs, ("x",), encode(hello)) == hello
    assert DECODER.decode(codecs, ("x",), encode(m.Hello("x", 7))).region == "here"
    assert DECODER.from_member("x", encode(hello)) == m.Hello("x", 7)  # an older coordinator


def test_an_error_in_a_key_names_it():
    plain = unpack(encode(m.Hello("x", 7)))
    plain[1]["kinds"] = [["XBad", [], [], [], []]]
    with pytest.raises(ProtocolError, match=r"^hello: kinds: .*XBad"):
        DECODER.from_member("x", pack(plain))


@pytest.mark.parametrize("bad", ["", "**", "a/b", "\x1b[2J", "x" * 100_000])
def test_names_in_a_hello_are_names(bad):
    """They become parts of keys, and of lines that people read."""
    kind = ["AThing", [], ["eHit"], ["eShow"], []]
    kinds = [[[*kind[:at], new, *kind[at + 1 :]]] for at, new in ((0, bad), (2, [bad]), (3, [bad]))]
    wrong = [(key, ["scan", bad]) for key in ("topics", "publishes")]
    wrong += [(key, ["eHit", bad]) for key in ("generates", "orders", "draws")]
    wrong += [("kinds", each) for each in kinds]
    # What people read about a member need not be a name.
    wrong += [("about", {"service": bad})] if "x" in bad or "[" in bad else []
    for key, value in wrong:
        plain = unpack(encode(m.Hello("x", 7)))
        plain[1][key] = value
        with pytest.raises(ProtocolError, match=f"^hello: {key}: ") as raised:
            DECODER.from_member("x", pack(plain))
        assert str(raised.value).isprintable()
        assert len(str(raised.value)) < 400


def test_a_key_that_must_be_there_is_named():
    plain = unpack(encode(m.Hello("x", 7)))
    del plain[1]["when"]
    with pytest.raises(ProtocolError, match="hello needs 'when'"):
        DECODER.from_member("x", pack(plain))


@pytest.mark.parametrize(("fields", "problem"), [
    ([("one", set)], "wrong: one: <class 'set'> does not travel"),
    ([("seen", Annotated[int, Mark.LOCAL]), ("count", int)], "local ones last"),
    ([("count", int), ("who", m.Sender)], "fields of the key come first"),
])  # fmt: skip
def test_a_wrong_declaration_is_an_error_where_it_is_compiled(fields, problem):
    wrong = make_dataclass("Wrong", fields, namespace={"WIRE": Wire("wrong", ("to",), "")})
    with pytest.raises(TypeError, match=problem):
        message_codec(wrong)


def test_events_may_be_declared_without_the_limits_of_a_generator():
    @dataclass(frozen=True, slots=True)
    class Free:
        WIRE: ClassVar = Wire("free", ("to",), "")
        events: tuple[AnyEvent, ...]

    free = Free((eNear(1.0),) * 5)
    assert DECODER.decode({"free": message_codec(Free)}, (), encode(free)) == free
