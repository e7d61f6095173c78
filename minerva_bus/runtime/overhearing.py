"""Listening to sensor topics without taking part: whoever records them is no member."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import zenoh
from zenoh.handlers import Callback

from minerva_bus.wire.keys import Keys

Hear = Callable[[str, str, bytes], None]
"""Told of a topic, of who publishes there, and of the message; in Zenoh's threads."""


def overhear(
    session: zenoh.Session, keys: Keys, topics: Collection[str], hear: Hear
) -> list[zenoh.Subscriber[Any]]:
    """Hear what comes on some topics of a world, on all of them where one is called `*`."""

    def told(sample: zenoh.Sample) -> None:
        topic, member = str(sample.key_expr).split("/")[-2:]
        hear(topic, member, sample.payload.to_bytes())

    every = f"{keys.base}/topic/*/*"
    wanted = [every] if "*" in topics else [keys.topic(topic) for topic in sorted(topics)]
    return [session.declare_subscriber(key, Callback(told, indirect=False)) for key in wanted]
