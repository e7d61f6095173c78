"""The epoch before a message: compact, complete, and distinct from any other prefix."""

import hypothesis.strategies as st
import msgpack
import pytest
from hypothesis import example, given

from minerva_bus.errors import ProtocolError
from minerva_bus.wire.codec import stamp, stamped


@given(epoch=st.integers(0, (1 << 64) - 1), message=st.binary(max_size=40))
@example(epoch=127, message=b"")
@example(epoch=128, message=b"x")
def test_a_stamped_message_is_its_epoch_and_the_message(epoch, message):
    assert stamped(stamp(epoch) + b"." + message) == (epoch, b"." + message)
    unpacker = msgpack.Unpacker()
    unpacker.feed(stamp(epoch))
    assert list(unpacker) == [epoch]


@pytest.mark.parametrize("data", [b"", b"\xc1", b"\x91\x01", b"\xcc", b"\xce\x00\x00", b"\xff"])
def test_every_other_prefix_is_rejected(data):
    with pytest.raises(ProtocolError, match="begins with its coordinator's epoch"):
        stamped(data)


def test_only_a_message_without_an_epoch_is_one_of_an_earlier_protocol():
    with pytest.raises(ProtocolError, match="as before protocol 4"):
        stamped(b"\x92\x01\x02")
    for data, named in ((b"\xff\x92", "ff"), (b"\xc1", "c1"), (b"", "nothing")):
        with pytest.raises(ProtocolError, match=f"not with {named}$"):
            stamped(data)


@given(st.binary(max_size=20))
def test_any_bytes_are_read_or_refused(data):
    try:
        epoch, _ = stamped(data)
    except ProtocolError:
        return
    assert 0 <= epoch < 1 << 64
