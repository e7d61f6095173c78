"""A member receives its messages in one order, from all sources and threads."""

import subprocess
import sys
import threading
from threading import Event, Thread
from typing import Any

import pytest
import zenoh

from minerva_bus.runtime import session_inbox
from minerva_bus.runtime.session import open_client, open_hub
from minerva_bus.runtime.session_inbox import HubInbox, Inbox, TimerTick
from tests.patience import patience
from tests.runtime.running import eventually


def test_messages_of_all_keys_arrive_in_sending_order():
    hub, endpoint = open_hub("hub")
    with hub, open_client("member", endpoint) as session:
        inbox = Inbox()
        inbox.open(session, "much")
        kept = session.declare_subscriber("little", inbox.handler())
        token = session.liveliness().declare_token("alive/member")
        eventually(lambda: list(hub.liveliness().get("alive/member")), "the member is there")
        block = zenoh.CongestionControl.BLOCK
        for number in range(300):
            hub.put("little" if number % 3 else "much", b"%d" % number, congestion_control=block)
        entries = [inbox.wait() for _ in range(300)]
        payloads = [x if isinstance(x, bytes) else x.payload.to_bytes() for x in entries]
        assert [int(entry) for entry in payloads] == list(range(300))
        assert [isinstance(entry, bytes) for entry in entries] == [n % 3 == 0 for n in range(300)]
        assert inbox.ready() is None
        inbox.close()
        kept.undeclare()
        token.undeclare()


def test_very_many_from_the_side_neither_block_nor_get_lost(monkeypatch):
    monkeypatch.setattr(Inbox, "capacity", 16)
    monkeypatch.setattr(session_inbox, "MAX_WAKE_UPS", 8)
    hub, _ = open_hub("hub")
    with hub:
        inbox = Inbox()
        inbox.open(hub, "much")
        thread = threading.Thread(target=lambda: [inbox.put(n) for n in range(1000)])
        thread.start()
        thread.join(patience(10))
        assert not thread.is_alive()
        assert [inbox.wait() for _ in range(1000)] == list(range(1000))
        inbox.close()


@pytest.mark.timeout(60)
def test_items_from_the_side_and_a_full_channel_do_not_block_each_other(monkeypatch):
    monkeypatch.setattr(HubInbox, "capacity", 16)
    monkeypatch.setattr(session_inbox, "MAX_WAKE_UPS", 8)
    hub, endpoint = open_hub("hub")
    with hub, open_client("a", endpoint) as session:
        inbox = HubInbox(0.05)
        inbox.open(hub, "from/*", "from/coordinator")
        for number in range(1000):
            inbox.put(number)
        block = zenoh.CongestionControl.BLOCK
        flood = session.declare_publisher("from/a", congestion_control=block)
        thread = threading.Thread(target=lambda: [flood.put(b"x") for _ in range(1000)])
        thread.start()
        items = []
        while len(items) < 2000:
            item = inbox.wait()
            items += [] if item is None or isinstance(item, TimerTick) else [item]
        assert [entry for entry in items if isinstance(entry, int)] == list(range(1000))
        assert items.count(("a", b"x")) == 1000
        thread.join()
        inbox.close()


def test_items_put_before_opening_are_received():
    hub, _ = open_hub("hub")
    with hub:
        inbox = Inbox()
        inbox.put("early")
        inbox.open(hub, "much")
        assert inbox.wait() == "early"
        inbox.close()


def test_the_hub_receives_senders_and_a_clock():
    hub, endpoint = open_hub("hub")
    with hub, open_client("a", endpoint) as session:
        inbox = HubInbox(0.05)
        inbox.open(hub, "from/*", "from/coordinator")
        session.put("from/a", b"hello", congestion_control=zenoh.CongestionControl.BLOCK)
        inbox.put("aside")
        items = []
        while not {"TimerTick", "aside", ("a", b"hello")} <= set(items):
            item = inbox.wait()
            items.append("TimerTick" if isinstance(item, TimerTick) else item)
        inbox.close()


ENDING = """
import sys
import threading
from contextlib import suppress
from queue import Empty
import zenoh
from minerva_bus.runtime.session_inbox import Inbox

sys.setswitchinterval(1e-5)
session = zenoh.open(zenoh.Config.from_json5('{scouting: {multicast: {enabled: false}}}'))
inbox = Inbox()
(channel,) = inbox.open(session, "much")


def knock():
    while True:
        inbox.put("again")
        with suppress(Empty):
            inbox._side.get_nowait()


for _ in range(4):
    threading.Thread(target=knock, daemon=True).start()
for _ in range(1000):
    inbox.wait()
channel.undeclare()
inbox.close()
"""


def test_a_process_ends_while_a_wake_up_is_pending():
    for _ in range(3):
        done = subprocess.run([sys.executable, "-c", ENDING], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")


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
