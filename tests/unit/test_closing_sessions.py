"""The end of a process whose sessions are still being closed in threads."""

import os
import threading
from typing import Any

import pytest

from minerva_bus.runtime.session import close_aside, end_at_once


class Slow:
    """A session that waits for an attempt to connect before it closes."""

    def __init__(self) -> None:
        self.released = threading.Event()

    def close(self) -> None:
        self.released.wait()


def test_a_process_ends_at_once_while_a_link_is_being_closed(monkeypatch: pytest.MonkeyPatch):
    codes: list[int] = []
    monkeypatch.setattr(os, "_exit", codes.append)
    end_at_once(3)
    assert codes == []
    session: Any = Slow()
    closing = close_aside(session)
    end_at_once(3)
    assert codes == [3]
    session.released.set()
    closing.join()
    end_at_once(3)
    assert codes == [3]
