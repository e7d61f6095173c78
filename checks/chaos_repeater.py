"""A client of checks/chaos.py that repeats the messages of a world."""

from __future__ import annotations

import threading
from collections import Counter
from contextlib import suppress
from random import Random

from checks.chaos_world import NAME
from minerva_bus.runtime.session import open_client


class Repeater:
    """Repeats messages on the bus after a short delay; `sent` is their number."""

    def __init__(self, endpoint: str, random: Random) -> None:
        self.sent = 0
        self._session = open_client("repeater", endpoint)
        self._random = random
        keys = (f"minerva/{NAME}/from/*", f"minerva/{NAME}/tick", f"minerva/{NAME}/evolve")
        self._own: Counter[bytes] = Counter()
        self._subscribers = [self._session.declare_subscriber(key, self._receive) for key in keys]

    def _receive(self, sample: object) -> None:
        key, data = str(sample.key_expr), sample.payload.to_bytes()  # type: ignore[attr-defined]
        if self._own[data] > 0:  # a repeated message
            self._own[data] -= 1
            return
        if len(data) < 20000 and b"emitted" not in data[:16] and self._random.random() < 0.1:
            self._own[data] += 1
            threading.Timer(self._random.random() * 0.3, self._send, (key, data)).start()

    def _send(self, key: str, data: bytes) -> None:
        with suppress(Exception):
            self._session.put(key, data)
            self.sent += 1

    def close(self) -> None:
        self._session.close()
