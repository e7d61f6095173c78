"""A real HTTP server that speaks the chat API of language models, with faults."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@dataclass(frozen=True)
class Answered:
    """What the server sends: a text as the answer, or a status with a raw body; or it hangs."""

    text: str = ""
    status: int = 200
    raw: str | None = None
    headers: dict[str, str] = field(default_factory=dict)
    hangs: bool = False


class ChatServer:
    """Serves until the end of a `with` block; `answer` gets the JSON object of each call.

    `calls` has these objects, `keys` the sent keys, `most` the most calls at the same time.
    """

    def __init__(self, answer: Callable[[dict], Answered], port: int = 0) -> None:
        self.calls: list[dict] = []
        self.keys: list[str] = []
        self.most = self._now = 0
        self._lock = threading.Lock()
        self._links: list[socket.socket] = []
        self.released = threading.Event()
        rig = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                rig.keys.append(self.headers.get("Authorization", ""))
                self.send(200, json.dumps({"data": [{"id": "small"}, {"id": "large"}]}), {})

            def do_POST(self) -> None:
                asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                rig.keys.append(self.headers.get("Authorization", ""))
                with rig._lock:
                    rig.calls.append(asked)
                    rig._now += 1
                    rig.most = max(rig.most, rig._now)
                try:
                    answered = answer(asked)
                finally:
                    with rig._lock:
                        rig._now -= 1
                if answered.hangs:
                    rig.released.wait()
                    self.close_connection = True
                    return
                message = {"role": "assistant", "content": answered.text}
                usage = {"prompt_tokens": 100, "completion_tokens": 20}
                content = json.dumps({"choices": [{"message": message}], "usage": usage})
                self.send(answered.status, answered.raw or content, answered.headers)

            def send(self, status: int, content: str, headers: dict[str, str]) -> None:
                body = content.encode()
                self.send_response(status)
                self.send_header("Content-Length", str(len(body)))
                for name, value in headers.items():
                    self.send_header(name, value)
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                """Nothing."""

        class Server(ThreadingHTTPServer):
            daemon_threads = True
            block_on_close = False
            request_queue_size = 128

            def get_request(self) -> tuple:
                accepted = super().get_request()
                rig._links.append(accepted[0])
                return accepted

            def handle_error(self, request: object, client_address: object) -> None:
                """Nothing: clients may cancel."""

        self._server = Server(("127.0.0.1", port), Handler)
        self.port = self._server.server_address[1]
        self.url = f"http://127.0.0.1:{self.port}/v1"

    def __enter__(self) -> ChatServer:
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.released.set()
        self._server.shutdown()
        self._server.server_close()
        for link in self._links:  # a killed server has no open connections
            with contextlib.suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)


def prompt_of(asked: dict) -> str:
    """The text of the request itself."""
    return next(turn["content"] for turn in asked["messages"] if turn["role"] == "user")
