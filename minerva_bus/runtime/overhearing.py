"""Subscribes to sensor topics without being a member, for records."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import zenoh
from zenoh.handlers import Callback

from minerva_bus.wire.keys import Keys, is_name


def overhear(
    session: zenoh.Session,
    keys: Keys,
    topics: Collection[str],
    receive: Callable[[str, str, bytes], None],
) -> list[zenoh.Subscriber[Any]]:
    """Subscribe to topics of a world; `*` stands for all of them.

    `receive` is called with topic, publisher and message, in threads of Zenoh.
    """

    def on_sample(sample: zenoh.Sample) -> None:
        topic, member = str(sample.key_expr).split("/")[-2:]
        # A message on a pattern reaches this subscription, too, but is of no topic.
        if is_name(topic) and is_name(member):
            receive(topic, member, sample.payload.to_bytes())

    all_topics = f"{keys.base}/topic/*/*"
    wanted = [all_topics] if "*" in topics else [keys.topic(topic) for topic in sorted(topics)]
    return [session.declare_subscriber(key, Callback(on_sample, indirect=False)) for key in wanted]
