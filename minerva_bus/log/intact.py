"""Selects the usable frames of a damaged record.

A frame stores how it changes the string of the frame before. After damaged bytes the string is
known again if the frame numbers continue without a gap, because then no frame was lost, or at the
next keyframe.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

from minerva_bus.log import channels as c
from minerva_bus.log.chunks import Chunks, Message
from minerva_bus.log.entries import Keyframe


class IntactMessages:
    """Iterates over the chunks `begin` to `end` (exclusive), in order.

    `start` is the frame whose string is known at the beginning. `decode` decodes a keyframe.
    During iteration, `lost` lists frames whose strings are unknown, `tears` counts places with
    lost bytes, and `open` is whether no string is known after frame `reached` - 1.
    """

    def __init__(
        self, chunks: Chunks, decode: Callable[[bytes], Keyframe], begin: int, start: int, end: int
    ) -> None:
        self._chunks = chunks
        self._decode = decode
        self._range = range(begin, end)
        self.reached = start
        self.tears: int = 0
        self.lost: list[range] = []
        self.open = False
        self._base: Keyframe | None = None

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, Message, Keyframe | None]]:
        """Topic and message of some topics, without lost frames and their checkpoints.

        The first frame after lost ones is returned with the keyframe before it.
        """
        for chunk in self._range:
            torn = self._chunks.torn(chunk)
            self._note(torn=torn)
            # A tear before the first chunk precedes the keyframe from which the iteration starts.
            self.tears -= torn and chunk == self._range.start
            # Frames and keyframes are always read, because they determine which strings are known.
            messages = self._chunks.messages_in(chunk, {*topics, c.KEYFRAME, c.FRAME})
            self._note(torn=messages is None)
            for topic, message in messages or ():
                if topic == c.KEYFRAME and self.open:
                    self._restart(message.data)
                if self._counts(topic, message.sequence) and topic in topics:
                    yield topic, message, self._taken_base(topic)
        self._note(torn=self._chunks.torn(self._range.stop))

    def _note(self, *, torn: bool) -> None:
        self.tears += torn
        self.open = self.open or torn

    def _taken_base(self, topic: str) -> Keyframe | None:
        base = self._base if topic == c.FRAME else None
        if topic == c.FRAME:
            self._base = None
        return base

    def _restart(self, data: bytes) -> None:
        keyframe = self._decode(data)
        self.open = False
        # Otherwise no frame is missing, and the damaged bytes contained something else.
        if keyframe.number > self.reached:
            self.lost.append(range(self.reached, keyframe.number))
            self._base = keyframe
        else:
            self._base = None
        self.reached = max(keyframe.number, self.reached)

    def _counts(self, topic: str, number: int) -> bool:
        if topic == c.CHECKPOINT:  # It precedes the frame after which it is valid.
            return not self.open or number <= self.reached + 1
        if topic == c.INPUTS:
            return not self.open or number <= self.reached
        if topic == c.KEYFRAME:
            return self._base is None
        if topic != c.FRAME:
            return True
        # The frame after the last known one follows without a gap,
        # so nothing was lost between them.
        self.open = self.open and number > self.reached
        if not self.open:
            self.reached = max(self.reached, number + 1)
        return not self.open
