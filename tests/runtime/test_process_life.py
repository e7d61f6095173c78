"""The end of a process whose threads are in Zenoh: with its exit code, output and exit handlers."""

import subprocess
import sys

import pytest

BUSY = """
import atexit, threading
from zenoh.handlers import Callback
from minerva_bus.process_life import ended_by_system
from minerva_bus.runtime.session import LOOPBACK, open_session, session_config

with ended_by_system():
    atexit.register(print, "a handler")
    options = {{"listen/endpoints": [LOOPBACK]}}
    session = open_session(session_config("router", "hub", options, False, None))
    arrived = threading.Event()
    subscriber = session.declare_subscriber(
        "a/**", Callback(lambda _: arrived.set(), indirect=False)
    )

    def publish():
        while True:
            session.put("a/b", b"some")

    for _ in range(2):
        threading.Thread(target=publish, daemon=True).start()
    assert arrived.wait(30)
    threading.Thread(target=print, args=["a thread"]).start()
    {ends}
"""


@pytest.mark.parametrize(
    ("ends", "code"),
    [("pass", 0), ("raise SystemExit", 0), ("exit(7)", 7), ("exit('why')", 1), ("1 / 0", 1)],
)
def test_threads_in_zenoh_do_not_abort_a_process(ends, code):
    done = subprocess.run(
        [sys.executable, "-c", BUSY.format(ends=ends)], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == code, done.stderr
    assert done.stdout == "a thread\na handler\n"
    assert ("why" in done.stderr) == ("why" in ends)
    assert ("ZeroDivisionError" in done.stderr) == ("/" in ends)
    assert "FATAL" not in done.stderr


def test_a_process_without_sessions_ends_as_usual():
    program = (
        "from minerva_bus.process_life import ended_by_system\n"
        "class Last:\n    def __del__(self):\n        print('deleted')\n"
        "with ended_by_system():\n    last = Last()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stdout == "deleted\n"
