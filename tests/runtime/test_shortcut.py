"""The shortcut for frames in which nothing happens says what the codec says."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.grammar.symbols import EventType
from minerva_bus.runtime.shortcut import nothing_to, says_nothing, tick
from minerva_bus.wire.codec import encode

frames = st.integers(0, 2**63 - 1)


@given(frames)
def test_a_tick_is_read_as_the_codec_reads_it(frame):
    assert tick(encode(m.TickRequest(frame))) == m.TickRequest(frame)


@given(frames)
def test_nothing_is_said_as_the_codec_says_it(frame):
    assert nothing_to(encode(m.TickRequest(frame))) == encode(m.TickReply("any", frame))


@pytest.mark.parametrize("message", [m.Greet(), m.Stop("tick"), m.Repeat("tick")])
def test_other_messages_are_left_to_the_codec(message):
    assert tick(encode(message)) is None


@given(st.binary(max_size=12))
def test_no_bytes_do_harm(data):
    begin = encode(m.TickRequest(0))[:-1]
    try:
        found = tick(begin + data)
    except ProtocolError:
        return
    assert found is None or found.frame >= 0


def test_only_nothing_is_nothing():
    said = EventType("eSaid")()
    assert says_nothing(m.TickReply("a", 3), 3)
    assert not says_nothing(m.TickReply("a", 3), 4)
    assert not says_nothing(m.TickReply("a", 3, (said,)), 3)
    assert not says_nothing(m.TickReply("a", 3, (), {}), 3)
    assert not says_nothing(m.Leaving("a"), 3)
