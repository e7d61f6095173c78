"""Which frames of a record can be used although some of it is damaged.

A frame says what it changes in the string that the frame before has left. So behind damaged bytes
the strings are known again where the numbers of the frames go on without a gap, since then no frame
was among those bytes, or from the next whole string on.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

from minerva_bus.grammar.scene import Scene
from minerva_bus.log import channels as c
from minerva_bus.log.chunks import Chunks, Message


class Sound:
    """Goes over the chunks from `begin` up to but without `end`, in order.

    `start` is the frame of which the string is known there. `decode` reads a whole string. As it
    goes, `lost` are the frames whose strings are not known, `since` is the chunk from which on no
    frame was lost, and `open` says that after frame `reached` - 1 nothing can be used.
    """

    def __init__(
        self,
        chunks: Chunks,
        decode: Callable[[bytes], tuple[int, Scene]],
        begin: int,
        start: int,
        end: int,
    ) -> None:
        self._chunks = chunks
        self._decode = decode
        self._range = range(begin, end)
        self.reached = start
        self.since = begin
        self.lost: list[range] = []
        self.open = False
        self._base: Scene | None = None

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, Message, Scene | None]]:
        """Topic and message of some topics without lost frames and their checkpoints.

        Beside the first frame after lost ones stands the string before it, which is no message.
        """
        for chunk in self._range:
            self.open = self.open or self._chunks.torn(chunk)
            some = self._chunks.messages_in(chunk, {*topics, c.STRING, c.FRAME})
            self.open = self.open or some is None
            for topic, message in some or ():
                if topic == c.STRING and self.open:
                    self._begin_anew(message.data, chunk)
                if self._counts(topic, message.sequence) and topic in topics:
                    yield topic, message, self._taken_base(topic)
        self.open = self.open or self._chunks.torn(self._range.stop)

    def _taken_base(self, topic: str) -> Scene | None:
        base = self._base if topic == c.FRAME else None
        if topic == c.FRAME:
            self._base = None
        return base

    def _begin_anew(self, data: bytes, chunk: int) -> None:
        number, self._base = self._decode(data)
        self.open = False
        if number > self.reached:
            self.lost.append(range(self.reached, number))
            self.since = chunk
        else:
            self._base = None
        self.reached = max(number, self.reached)

    def _counts(self, topic: str, number: int) -> bool:
        if topic == c.CHECKPOINT:  # It stands before the frame that has led to it.
            return not self.open or number <= self.reached + 1
        if topic == c.STRING:
            return self._base is None
        if topic != c.FRAME:
            return True
        self.open = self.open and number > self.reached
        if not self.open:
            self.reached = max(self.reached, number + 1)
        return not self.open
