"""Every message encodes to its recorded bytes and back (tools/golden_messages.py)."""

from typing import get_args

import pytest

from minerva_bus.frame import messages as m
from minerva_bus.wire.codec import Decoder, encode
from tools.golden_messages import MESSAGES, VOCABULARY, recorded_messages, shown

RECORDED = recorded_messages()


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_has_its_golden_bytes(name):
    assert shown(encode(MESSAGES[name])) == RECORDED[name]


@pytest.mark.parametrize("name", MESSAGES)
def test_golden_bytes_are_read_as_the_message(name):
    message, decoder = MESSAGES[name], Decoder(VOCABULARY)
    data = encode(message)
    match message:
        case m.FrameRecord():
            back: m.Message = decoder.record(data)
        case m.Readings():
            back = decoder.readings(message.topic, message.member, data)
        case _ if type(message) in get_args(m.ToMember):
            back = decoder.to_member(data)
        case _:
            back = decoder.from_member(message.member, data)
    assert type(back) is type(message)
    assert encode(back) == data
    names = [
        name for name in type(message).__slots__ if isinstance(getattr(message, name), int | str)
    ]
    assert [getattr(back, name) for name in names] == [getattr(message, name) for name in names]


def test_every_message_has_several_golden_values():
    samples = {}
    for message in MESSAGES.values():
        samples.setdefault(type(message), []).append(message)
    assert samples.keys() == set(get_args(m.Message))
    assert RECORDED.keys() == MESSAGES.keys()
    for kind, values in samples.items():
        fields = set(kind.__slots__) - {"member"}
        assert len(values) >= 2 or not fields, f"{kind.__name__} has one value only"
