"""Items of several threads keep their places among the messages of the channel."""

from threading import Event, Thread
from typing import Any

import pytest

from minerva_bus.runtime.inbox import Inbox
from tests.patience import patience


def test_a_wake_up_belongs_to_the_item_that_was_put_with_it(monkeypatch: pytest.MonkeyPatch):
    """Otherwise an item of another thread takes it, and the first one waits for a later one.

    A message of the channel in between, such as a request after a welcome, would overtake it.
    """
    inbox, woken, done = Inbox(), list[str](), Event()
    put: Any = inbox._side.put

    def second():
        inbox.put("second")
        done.set()

    class Side:
        def put(self, item: str):
            put(item)
            if item == "first":
                Thread(target=second, daemon=True).start()
                done.wait(0.2)  # It is not done before the first one has sent its wake-up.

        def qsize(self) -> int:
            return 0

    monkeypatch.setattr(inbox, "_side", Side())
    monkeypatch.setattr(inbox, "_wake", lambda sign: woken.append("done" if done.is_set() else ""))
    inbox.put("first")
    assert done.wait(patience(5))
    assert woken == ["", ""]
