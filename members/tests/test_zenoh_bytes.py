"""The bytes in docs/reference/protocol/zenoh-wire.md, sent to a Zenoh router as they stand there."""

import json
import queue
import re
import socket
from pathlib import Path

import pytest
import zenoh

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "protocol" / "zenoh-wire.md"
DOCUMENT = PAGE.read_text(encoding="utf-8")
INIT_ANSWER, OPEN_ANSWER, FRAME = 0x01, 0x02, 0x05


def examples() -> dict[str, bytes]:
    """The examples by their first line."""
    result = {}
    for title, body in re.findall(r"^```hex zenoh\n# ([\w ]+)\n(.*?)^```$", DOCUMENT, re.M | re.S):
        digits = [re.split(r"\s{2,}", line.strip())[0] for line in body.splitlines()]
        result[title] = bytes.fromhex(" ".join(digits))
    return result


EXAMPLES = examples()


def router(port: int) -> zenoh.Config:
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return config


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


class Link:
    """Batches over TCP."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port))

    def send(self, batch: bytes) -> None:
        self.socket.sendall(len(batch).to_bytes(2, "little") + batch)

    def receive(self) -> bytes:
        return self._read(int.from_bytes(self._read(2), "little"))

    def _read(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = self.socket.recv(size - len(data))
            assert piece, "the router has closed the link"
            data += piece
        return data

    def frame_with(self, part: bytes) -> bytes:
        """The next frame that contains these bytes."""
        while True:
            batch = self.receive()
            if batch[0] & 0x1F == FRAME and part in batch:
                return batch

    def open(self, hello: bytes, cookie_of_example: bytes) -> None:
        self.send(EXAMPLES["init"])
        answer = self.receive()
        assert answer[0] & 0x3F == 0x20 | INIT_ANSWER
        assert answer[1] == EXAMPLES["init"][1], "another version of Zenoh's protocol"
        identity = (answer[2] >> 4) + 1
        slice_ = answer[3 + identity + (3 if answer[0] & 0x40 else 0) :]
        cookie = slice_[: 1 + slice_[0]]
        assert slice_[0] < 0x80
        assert hello.endswith(cookie_of_example)
        self.send(hello.removesuffix(cookie_of_example) + cookie)
        assert self.receive()[0] & 0x3F == 0x20 | OPEN_ANSWER


def test_a_router_understands_the_examples() -> None:
    port = free_port()
    seen: queue.Queue[tuple[str, str, bytes]] = queue.Queue()

    def record(sample: zenoh.Sample) -> None:
        seen.put((str(sample.kind), str(sample.key_expr), sample.payload.to_bytes()))

    with zenoh.open(router(port)) as session:
        handler = zenoh.handlers.Callback(record, indirect=False)
        kept = [session.declare_subscriber("minerva/w/from/*", handler)]
        kept.append(session.liveliness().declare_subscriber("minerva/w/alive/rain", handler))
        own = session.liveliness().declare_token("minerva/w/alive/coordinator")
        link = Link(port)
        link.open(EXAMPLES["open"], bytes.fromhex("02 aa bb"))
        for title in ("keep alive", "subscriber", "interest"):
            link.send(EXAMPLES[title])
        assert link.frame_with(b"minerva/w/alive/coordinator")
        link.send(EXAMPLES["token"])
        assert seen.get() == ("SampleKind.PUT", "minerva/w/alive/rain", b"")
        session.put("minerva/w/all", b"to all members")
        assert link.frame_with(b"to all members")
        link.send(EXAMPLES["put"])
        assert seen.get() == ("SampleKind.PUT", "minerva/w/from/rain", b"\x00\x91\xa7leaving")
        link.send(EXAMPLES["undeclared token"])
        assert seen.get() == ("SampleKind.DELETE", "minerva/w/alive/rain", b"")
        link.send(EXAMPLES["close"])
        own.undeclare()
        with pytest.raises((AssertionError, OSError)):
            link.frame_with(b"no frame has this")


def test_each_example_is_known() -> None:
    assert list(EXAMPLES) == [
        "init", "open", "keep alive", "subscriber", "interest", "token", "put", "undeclared token", "close",
    ]  # fmt: skip
