"""A TCP proxy for tests that delays all data and can cut connections."""

from __future__ import annotations

import queue
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from random import Random
from typing import Final, Self

CHUNK: Final = 65536


def slow_line(random: Random, latency: float, lost: float = 0.0) -> Callable[[], float]:
    """Delays in seconds: `latency`, and more for lost data.

    `lost` is the share that TCP has to send again, which takes a fifth of a second and delays the
    data behind it. One `Random` gives one series of delays.
    """
    return lambda: latency + (0.2 + 2 * latency if random.random() < lost else 0.0)


class Proxy:
    """A proxy for a TCP port; a context manager that closes it.

        with Proxy(port, slow_line(Random(1), 0.05, 0.01)) as proxy:
            open_client("a", f"tcp/127.0.0.1:{proxy.port}")

    Data keep their order; `delay` gives the seconds for each chunk. Latency does not
    cost bandwidth: chunks keep their distance in time.
    """

    def __init__(
        self, port: int, delay: Callable[[], float], host: str = "127.0.0.1", at: int = 0
    ) -> None:
        """`at` is the port to listen on; 0: any free one."""
        self._to = (host, port)
        self._delay = delay
        self._links: set[socket.socket] = set()
        self._lock = threading.Lock()
        self._server = socket.create_server(("127.0.0.1", at))
        self.port: int = self._server.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def cut(self) -> int:
        """Break all connections and return their number. New ones are still accepted."""
        with self._lock:
            # Removed under the lock, because the accepting thread may add links at the same time.
            links, self._links = self._links, set()
        for link in links:
            with suppress(OSError):
                # `shutdown`, not `close`, wakes the threads that wait in `recv`.
                link.shutdown(socket.SHUT_RDWR)
        # Two sockets for each connection.
        return len(links) // 2

    def close(self) -> None:
        """Accept no more connections, and break the open ones."""
        with suppress(OSError):
            # Wakes the thread that waits in `accept`; closing alone would leave it there.
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self.cut()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._server.accept()
                try:
                    far = socket.create_connection(self._to)
                except OSError:
                    # The client sees a closed connection, as from a port without a listener.
                    near.close()
                    continue
                with self._lock:
                    self._links |= {near, far}
                for source, target in ((near, far), (far, near)):
                    # Without it, TCP may hold back small chunks and add to the configured delay.
                    source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._carry(source, target)

    def _carry(self, source: socket.socket, target: socket.socket) -> None:
        late: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
        for what, link in ((self._take, source), (self._give, target)):
            threading.Thread(target=what, args=(link, late), daemon=True).start()

    def _take(self, link: socket.socket, late: queue.SimpleQueue[tuple[float, bytes]]) -> None:
        """Read until the end of the stream, which becomes an empty chunk."""
        data = b" "
        while data:
            try:
                data = link.recv(CHUNK)
            except OSError:
                data = b""
            # Due times are fixed on arrival, so the delays of successive chunks overlap.
            late.put((time.monotonic() + self._delay(), data))

    def _give(self, link: socket.socket, late: queue.SimpleQueue[tuple[float, bytes]]) -> None:
        """Write each chunk when it is due; end when the other side has ended."""
        with suppress(OSError):
            while True:
                due, data = late.get()
                time.sleep(max(0.0, due - time.monotonic()))
                if not data:
                    break
                link.sendall(data)
        with suppress(OSError):
            link.shutdown(socket.SHUT_RDWR)
        with self._lock:
            self._links.discard(link)
