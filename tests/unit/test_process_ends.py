"""Ends of processes: sessions that threads still close, and pipes of other handlers."""

import os
import threading
from typing import Any

import pytest

from minerva_bus.launch.child_processes import Pipes
from minerva_bus.runtime.session import close_aside, end_at_once
from tests.patience import patience


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


def test_the_handler_of_a_closed_pipe_is_not_called():
    pipes, calls = Pipes(), []
    ends = [os.pipe() for _ in range(2)]

    def read_all():
        calls.append("once")
        for read, _ in ends:
            assert pipes.read(read) is None  # and closes it

    for read, write in ends:
        pipes.listen(read, read_all)
        os.close(write)
    pipes.wait(patience(5))
    assert calls == ["once"]
    pipes.close()
