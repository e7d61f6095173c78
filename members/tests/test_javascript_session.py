"""The Zenoh session of the package in JavaScript, against a router that ends and returns."""

import queue
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import zenoh
from test_zenoh_bytes import free_port, router

SOURCE = Path(__file__).parents[2] / "members" / "javascript" / "src"
ECHO = f"""
import {{ Session }} from "{SOURCE / "zenoh.js"}";

const session = await Session.open(process.argv[1], {{
  onSample: ({{ payload }}) => session.put("t/back", payload),
}});
session.subscribe("t/in");
session.declareToken("t/alive");
process.on("SIGTERM", () => session.close());
"""

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="needs node")


def kind_of(sample: Any) -> str:
    return str(sample.kind)


def payload_of(sample: Any) -> bytes:
    return sample.payload.to_bytes()


def exchange(port: int, sizes: tuple[int, ...]) -> None:
    """Open a router, wait for the program's token, and get payloads of these sizes back."""
    alive: queue.Queue[str] = queue.Queue()
    back: queue.Queue[bytes] = queue.Queue()
    with zenoh.open(router(port)) as session:
        token = session.liveliness().declare_subscriber(
            "t/alive",
            zenoh.handlers.Callback(lambda sample: alive.put(kind_of(sample)), indirect=False),
            history=True,
        )
        answers = session.declare_subscriber(
            "t/back",
            zenoh.handlers.Callback(lambda sample: back.put(payload_of(sample)), indirect=False),
        )
        assert alive.get() == "SampleKind.PUT"
        for size in sizes:
            payload = bytes(n % 251 for n in range(size))
            session.put("t/in", payload, congestion_control=zenoh.CongestionControl.BLOCK)
            assert back.get() == payload
        token.undeclare()
        answers.undeclare()


def test_a_session_returns_with_its_declarations() -> None:
    """Payloads above the size of a batch travel in fragments, also after the router has returned."""
    port = free_port()
    with zenoh.open(router(port)) as first:
        ready: queue.Queue[str] = queue.Queue()
        first.liveliness().declare_subscriber(
            "t/alive",
            zenoh.handlers.Callback(lambda sample: ready.put(kind_of(sample)), indirect=False),
            history=True,
        )
        program = subprocess.Popen(
            ["node", "--input-type=module", "-e", ECHO, f"tcp/127.0.0.1:{port}"],
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            assert ready.get() == "SampleKind.PUT"
        except queue.Empty:
            program.kill()
            raise
    try:
        exchange(port, (0, 1, 65_000, 70_000, 1_000_000))
        exchange(port, (10,))
        program.terminate()
        _, problems = program.communicate()
    finally:
        program.kill()
    assert problems == ""
    assert program.returncode == 0
