"""Metrics and health of a world over HTTP: /metrics, /live and /ready.

Separate threads query the coordinator like an operator: it answers between two messages, and the
formatting of the answer does not delay the frame.
"""

from __future__ import annotations

import socket
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final, Self, cast

from minerva_bus.errors import BusError, MinervaError, ProtocolError
from minerva_bus.frame.world_state import Phase
from minerva_bus.runtime.metrics import BOUNDS, Durations, Totals
from minerva_bus.settings.kinds import address
from minerva_bus.wire.plain import as_int, as_list, as_map, as_number
from minerva_bus.wire.status_codec import read_status
from minerva_bus.wording import install
from minerva_bus.world.operator import WorldStatus
from minerva_services.web_access import WebAccess

if TYPE_CHECKING:
    from prometheus_client.core import Metric

QUERY_SECONDS: Final = 2.0
"""Time between queries for the totals, which are counted only while queries arrive."""

READY_SECONDS: Final = 2.0
"""Time that a frame may wait for a member while the world counts as ready."""

Ask = Callable[..., Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Health:
    """The result of a health check, with a reason."""

    ok: bool
    text: str

    @property
    def code(self) -> int:
        """The HTTP status: 200 or 503."""
        return 200 if self.ok else 503


Check = Callable[[WorldStatus | None, str], Health]


def live(status: WorldStatus | None, problem: str = "") -> Health:
    """Whether the coordinator answers; `status` is its answer, `problem` the reason for none."""
    # Members are irrelevant here: an orchestrator must not restart a coordinator because a sensor
    # is missing.
    if status is None:
        return Health(False, f"the coordinator does not answer: {problem}")
    return Health(True, f"{status.world}: the coordinator answers")


def ready(status: WorldStatus | None, problem: str = "") -> Health:
    """Whether the world runs frames or could; a paused world is ready, too."""
    if status is None:
        return live(status, problem)
    names = ", ".join(status.waiting)
    if status.phase == Phase.WAITING.value:
        return Health(False, f"{status.world}: waiting for {names or 'members'} to join")
    if status.waiting and status.waited >= READY_SECONDS:
        waiting = f"frame {status.frame} has been waiting for {names} for {status.waited:.1f} s"
        return Health(False, f"{status.world}: {waiting}")
    doing = "paused before" if status.paused else "running"
    return Health(True, f"{status.world}: {doing} frame {status.frame}")


class Exporter:
    """Serves the metrics of one world until it is closed; `ask` queries its coordinator.

    Raises MisuseError for a wrong address, BusError if the port cannot be opened, and MinervaError
    without the extra `metrics`.
    """

    def __init__(self, world: str, listen: str, ask: Ask) -> None:
        host, port = address(listen)
        if find_spec("prometheus_client") is None:
            raise MinervaError(f"metrics need prometheus-client: {install('metrics')}")
        self.world = world
        self.access = WebAccess(host, port)
        self._ask = ask
        try:
            self._server = _MetricsServer((host, port), self)
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise BusError(
                f"cannot serve metrics at {listen}: {why}; choose another port, or port 0 for any"
                " that is free"
            ) from None
        self._closed = threading.Event()
        # The argument below is the interval in seconds at which the server notices `close`.
        serve = self._server.serve_forever
        threading.Thread(target=serve, args=(0.1,), daemon=True).start()
        threading.Thread(target=self._keep_awake, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    @property
    def url(self) -> str:
        """The URL of the metrics."""
        host, port = self._server.server_address[:2]
        shown = f"[{host}]" if ":" in str(host) else host
        return f"http://{shown}:{port}/metrics"

    def close(self) -> None:
        """Stop serving."""
        self._closed.set()
        self._server.shutdown()
        self._server.server_close()

    def health(self, check: Check) -> Health:
        """The result of one of the health checks."""
        try:
            return check(self._status(), "")
        except MinervaError as error:
            return check(None, str(error))

    def collect(self) -> Iterator[Metric]:
        """Collect metrics, as Prometheus requires of a collector."""
        from minerva_monitoring.prometheus_metrics import down_metrics, world_metrics

        try:
            status, totals = self._status(), read_totals(self._ask("totals").get("totals"))
        except MinervaError:
            # `/metrics` always replies; `minerva_up` reports a world that does not answer.
            return down_metrics(self.world)
        return world_metrics(status, totals)

    def _status(self) -> WorldStatus:
        return read_status(self._ask("status").get("status"))

    def _keep_awake(self) -> None:
        # Frames are measured only while queries arrive; a scraper with a longer period would miss
        # some.
        while not self._closed.wait(QUERY_SECONDS):
            try:
                self._ask("totals")
            except MinervaError:
                continue  # `/live` reports this.


@contextmanager
def exported(world: str, listen: str, ask: Ask, note: Callable[[str], None]) -> Generator[None]:
    """Serve the metrics of a world at an address during the block; `note` logs it."""
    with Exporter(world, listen, ask) as exporter:
        note(f"metrics at {exporter.url}")
        yield


class _MetricsServer(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, where: tuple[str, int], exporter: Exporter) -> None:
        self.exporter = exporter
        # Before the base class creates the socket.
        self.address_family = socket.AF_INET6 if ":" in where[0] else socket.AF_INET
        super().__init__(where, _Handler)

    def server_bind(self) -> None:
        """Bind without the reverse DNS look-up of the base class."""
        # Allows a restarted world to use its port at once.
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = map(str, self.server_address[:2])  # pyright: ignore

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log an error in one line; a client that closes its connection is none."""
        error = sys.exception()
        if not isinstance(error, OSError):
            what = f"{type(error).__name__}: {error}"
            sys.stderr.write(f"metrics: no reply to {client_address[0]}: {what[:200]}\n")


class _Handler(BaseHTTPRequestHandler):
    # Seconds; without it, a client that sends nothing would keep its thread forever.
    timeout = 10
    server_version, sys_version = "minerva", ""

    @property
    def _exporter(self) -> Exporter:
        return cast("_MetricsServer", self.server).exporter

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        refusal = self._exporter.access.refusal(self.path, self.headers)
        if refusal:
            self._reply(403, "text/plain; charset=utf-8", f"{refusal}\n".encode())
        elif path == "/metrics":
            self._metrics()
        elif path in _CHECKS:
            health = self._exporter.health(_CHECKS[path])
            self._reply(health.code, "text/plain; charset=utf-8", f"{health.text}\n".encode())
        else:
            self._reply(
                404, "text/plain; charset=utf-8", b"not found; expected /metrics, /live or /ready\n"
            )

    def _metrics(self) -> None:
        from prometheus_client import CollectorRegistry
        from prometheus_client.exposition import choose_encoder

        registry = CollectorRegistry(auto_describe=False)
        registry.register(self._exporter)  # pyright: ignore[reportArgumentType]
        encode, kind = choose_encoder(self.headers.get("Accept", ""))
        self._reply(200, kind, encode(registry))

    def _reply(self, code: int, kind: str, body: bytes) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Do not log requests."""


_CHECKS: Mapping[str, Check] = {"/live": live, "/ready": ready}


# --- the totals that the coordinator answers ---


def read_totals(plain: Any) -> Totals:
    """Totals from plain data. Raises ProtocolError."""
    given = as_map(plain, "totals")
    into, out = _pair(given.get("bytes"), "bytes")
    phases = as_map(given.get("phases"), "phases")
    events = as_map(given.get("events"), "events")
    return Totals(
        as_int(given.get("frames"), "frames"),
        {name: _durations(durations) for name, durations in phases.items()},
        {name: as_int(count, name) for name, count in events.items()},
        as_int(into, "bytes"),
        as_int(out, "bytes"),
    )


def _durations(plain: Any) -> Durations:
    counts, seconds = _pair(plain, "durations")
    numbers = [as_int(count, "a count") for count in as_list(counts, "counts")]
    if len(numbers) != len(BOUNDS) + 1:
        raise ProtocolError(f"durations have {len(BOUNDS) + 1} counts, not {len(numbers)}")
    return Durations(numbers, as_number(seconds, "seconds"))


def _pair(plain: Any, what: str) -> tuple[Any, Any]:
    values = as_list(plain, what)
    if len(values) != 2:
        raise ProtocolError(f"{what} are two values, not {len(values)}")
    return values[0], values[1]
