"""Sessions, clock and threads of a process on the bus.

The coordinator's Zenoh session is the hub, and each member's is a client of it. There is no
discovery, and without another endpoint only the loopback interface is used. Routers are needed only
between networks.

Coordinator and members take a `System` as an argument. A simulation passes its own, in which time
is a variable and each step is scheduled (tests/simulator).
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import json
import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

import zenoh
from zenoh.handlers import Callback

from minerva_bus.errors import BusError
from minerva_bus.process_life import session_opened
from minerva_bus.runtime.endpoints import (
    check_endpoint,
    check_port_free,
    check_reachable,
    obstacle,
    own_endpoint,
    why_unreachable,
)
from minerva_bus.security.credentials import Credentials
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.plain import DEFAULT

_AT_ONCE: Final = struct.pack("ii", 0, 0)
_BEYOND_LEASE: Final = 1.0
"""Seconds that the system keeps trying to deliver, beyond Zenoh's own lease."""


def sockets_to(address: str) -> Iterator[socket.socket]:
    """Copies of the sockets of a link to an address such as tls/10.0.0.2:7447, newest first.

    Newest first, so that a new link's socket is the first of a thousand. Links without a socket of
    their own (QUIC, sockets in the file system) have none. Each copy is closed before the next one
    is returned.
    """
    host, _, port = address.partition("/")[2].rpartition(":")
    for connection in _sockets() if port.isdecimal() else ():
        with connection, suppress(OSError):
            if connection.getpeername()[:2] == (host.strip("[]"), int(port)):
                yield connection


def let_dead_links_go(session: zenoh.Session, lease: float) -> None:
    """Make dead links of a session disappear soon, without a delay of other links.

    Zenoh closes a link after `lease` seconds without a message, but only after a pending write,
    which the system would retry for a quarter of an hour: TCP_USER_TIMEOUT shortens this, where it
    exists. Closing then blocks for up to ten seconds, until the rest is delivered, in a thread that
    serves other links: SO_LINGER of zero prevents that; the system still delivers what it can.
    """
    give_up_milliseconds = round(1000 * (lease + _BEYOND_LEASE))

    def new_link(event: Any) -> None:
        if event.kind != zenoh.SampleKind.PUT:
            return
        # The first match is the new link. Comparing all sockets would take quadratic time
        # in a world of a thousand members.
        for connection in islice(sockets_to(str(event.link.dst)), 1):
            with suppress(OSError, AttributeError):
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
                connection.setsockopt(
                    socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, give_up_milliseconds
                )

    session.info.declare_link_events_listener(Callback(new_link, indirect=True), history=True)


def _sockets() -> Iterator[socket.socket]:
    """Copies of all sockets of the process, the highest descriptor first."""
    for descriptor in sorted(
        (int(entry.name) for entry in Path("/dev/fd").iterdir()), reverse=True
    ):
        try:
            # A socket object closes its descriptor, so it gets a
            # copy: the original belongs to Zenoh.
            copy = os.dup(descriptor)
        except OSError:
            continue  # The descriptor of the directory listing itself.
        try:
            yield socket.socket(fileno=copy)
        except OSError:
            os.close(copy)


LOOPBACK = "tcp/127.0.0.1:0"

LEASE = 3.0
LEASE_PER_LINK = 0.03
"""Seconds without a keep-alive after which a link is closed: a minimum, and a value per link.

A hub with a thousand links on a slow machine sends its keep-alives late, and so do its clients.
"""
_links = 1
CONNECT_SECONDS = 5.0

# The events of a link arrive in the threads that opened it (app) or accepted it (acc), which wake
# the reading threads (rx): two context switches per message. With one pool for both there is one
# switch, and a client, which has one link, needs a single thread. Writing threads (tx) stay
# separate, so that a link is kept alive regardless of its readers. A reading thread handles what a
# link has sent before it turns to another one: the hub has more of them than cores, so that the
# messages of members do not wait for links that are flooded.
HUB_THREADS = "(rx:(worker_threads:6),acc:(handover:rx))"
CLIENT_THREADS = "(rx:(worker_threads:1),app:(handover:rx))"

_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    # Without discovery there is no need to wait for it.
    "scouting/delay": 0,
    "timestamping/enabled": False,
    # `listening_at` reads the port from it.
    "adminspace/enabled": True,
    # Microseconds. A member that does not read for a second loses its link: none of its messages
    # may be dropped, and the publication to all others must not wait longer.
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
}


_CLIENT: dict[str, Any] = {
    # Batches of 64 kB that may wait for the writing thread: the most that Zenoh allows, allocated
    # on use. With its two, a host stops in the middle of a large answer until the thread has
    # written: 190 kB took 230 us in place of 150, and 900 kB 1.3 ms in place of 0.6. The hub keeps
    # two for each of its links, because views for slow observers must not queue.
    "transport/link/tx/queue/size/data": 16
}
POOL_BYTES = 64 * 1024 * 1024
_SHARED: dict[str, Any] = {
    "transport/shared_memory/enabled": True,
    "transport/shared_memory/mode": "init",
    "transport/shared_memory/transport_optimization": {
        "enabled": True,
        "pool_size": POOL_BYTES,
        # In a plain exchange, 8 MB took 8 ms this way instead of about 30 ms.
        "message_size_threshold": 1024 * 1024,
    },
}
_UNSHARED: dict[str, Any] = {"transport/shared_memory/enabled": False}


def expect_links(number: int) -> None:
    """Adapt the lease of the sessions to the number of links that the hub will have.

    A setting of the process and its forks, because all of its sessions share it.
    """
    global _links
    _links = number


def lease() -> float:
    """Seconds after which a link of this process is closed without a keep-alive."""
    return max(LEASE, LEASE_PER_LINK * _links)


_CLOSED_WITHIN = 1.0
_still_closing: list[threading.Thread] = []
_REFUSED_WITHIN = 1.5
"""Time-out of a secured link in seconds: rejections are not reported."""


@fast_dataclass
class Secured:
    """Security of a coordinator's session.

    `access` is Zenoh's access control (`access.access_control`), `filters` its low-pass filters;
    `local` is an endpoint for processes of this machine, which need no certificate.
    """

    own: Credentials
    local: str
    access: Mapping[str, Any]
    filters: Sequence[Mapping[str, Any]] = ()


def open_hub(
    name: str,
    listen: str = LOOPBACK,
    *,
    shared: bool = False,
    secured: Secured | None = None,
    routers: Sequence[str] = (),
) -> tuple[zenoh.Session, str]:
    """The coordinator's session and its endpoint for members of this machine.

    `shared`: messages of a megabyte and more use shared memory, if the receiver does so, too.
    `routers` are Zenoh routers to join. Raises BusError if it cannot listen or reach a router.
    """
    check_port_free(check_endpoint(listen))
    # A value that the user has set has priority.
    os.environ.setdefault("ZENOH_RUNTIME", HUB_THREADS)
    # Processes of this machine have no certificates and use a Unix
    # socket that only their user reaches.
    endpoints = [listen] if secured is None else sorted({listen, secured.local})
    options: dict[str, Any] = {
        "listen/endpoints": endpoints,
        "listen/exit_on_failure": True,
        "transport/unicast/max_sessions": DEFAULT.links,
    }
    own = None if secured is None else secured.own
    if secured is not None:
        options["access_control"] = secured.access
        options["low_pass_filter"] = list(secured.filters)
    if routers:
        options |= _connecting(list(routers), CONNECT_SECONDS)
    try:
        # Zenoh reports a time-out only; this check names the reason.
        for router in routers:
            check_reachable(check_endpoint(router), CONNECT_SECONDS)
        session = open_session(session_config("router", name, options, shared, own))
    except BusError as error:
        raise BusError(f"no router can be joined: {error}") from None
    except zenoh.ZError as error:
        for router in routers:
            why = why_unreachable(check_endpoint(router), own, CONNECT_SECONDS)
            raise BusError(f"no router can be joined: {why}") from None
        brief = str(error).split(" at ", 1)[0][:200]  # without its place in Zenoh's source
        raise BusError(f"cannot listen at {listen}: {brief}") from None
    let_dead_links_go(session, lease())
    if secured is not None:
        return session, secured.local
    return session, own_endpoint(listen, listening_at(session, listen))


def listening_at(session: zenoh.Session, listen: str) -> str:
    """The endpoint of a session, with the actual port instead of 0."""
    if not listen.endswith(":0"):
        return listen
    for reply in session.get(f"@/{session.zid()}/router", timeout=5.0):
        if reply.ok is not None:
            locators: list[str] = json.loads(reply.ok.payload.to_string())["locators"]
            kind = listen.split("/", 1)[0]
            # A secured session listens at its local socket, too.
            own = [locator for locator in locators if locator.startswith(kind)]
            if own:
                return own[0]
    raise BusError(f"the session at {listen} does not report its endpoint")


def open_client(
    name: str,
    connect: str,
    patience: float = CONNECT_SECONDS,
    *,
    shared: bool = False,
    own: Credentials | None = None,
) -> zenoh.Session:
    """A member's session; `shared` as for the hub, `own` are its credentials.

    Raises BusError with a diagnosis if the endpoint is unreachable.
    """
    asked = check_endpoint(connect)
    if asked.secured and own is None:
        raise BusError(f"{connect} requires a certificate; name your keys with --keys FOLDER")
    if not asked.local:  # On this machine, a killed coordinator may be restarting.
        check_reachable(asked, patience)
    # Zenoh does not report a rejected certificate and tries until the time is over.
    within = min(patience, _REFUSED_WITHIN) if asked.secured else patience
    os.environ.setdefault("ZENOH_RUNTIME", CLIENT_THREADS)
    try:
        session = open_session(
            session_config("client", name, _connecting([connect], within) | _CLIENT, shared, own)
        )
    except zenoh.ZError:
        raise BusError(why_unreachable(asked, own, patience)) from None
    let_dead_links_go(session, lease())
    return session


@contextmanager
def closed_in_time(session: zenoh.Session) -> Generator[None]:
    """Close a session at the end, with a time-out.

    Zenoh waits until a pending connection attempt has failed, which takes up to ten seconds. To end
    the process earlier, call `end_at_once`.
    """
    try:
        yield
    finally:
        close_aside(session).join(_CLOSED_WITHIN)


def close_aside(session: zenoh.Session) -> threading.Thread:
    """Close a session in a thread, because it may wait for an attempt to connect."""

    def close() -> None:
        session.close()

    # A daemon, because a pending connection attempt must not keep the process.
    closing = threading.Thread(target=close, daemon=True)
    closing.start()
    # The process would wait for the thread of Zenoh that reports the links of this session.
    _still_closing.append(closing)
    return closing


def end_at_once(code: int) -> None:
    """End the process with this code if one of its sessions would delay the exit."""
    if any(thread.is_alive() for thread in _still_closing):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def open_session(config: zenoh.Config) -> zenoh.Session:
    """Open a session. Raises zenoh.ZError."""
    session_opened()
    return zenoh.open(config)


def _connecting(endpoints: list[str], within: float) -> dict[str, Any]:
    """Options of a session that tries for `within` seconds to reach endpoints."""
    return {
        "connect/endpoints": endpoints,
        "connect/timeout_ms": int(within * 1000),
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 20,
            "period_max_ms": 500,
            "period_increase_factor": 1.5,
        },
    }


def tls_settings(own: Credentials) -> dict[str, Any]:
    """TLS settings with one certificate for both directions; its purposes limit their use."""
    sides = {
        f"{side}_{what}": str(path.absolute())
        for side in ("listen", "connect")
        for what, path in (("private_key", own.key), ("certificate", own.certificate))
    }
    return {
        "root_ca_certificate": str(own.authority.absolute()),
        "enable_mtls": True,
        "close_link_on_expiration": True,
        **sides,
    }


def session_config(
    mode: str, name: str, options: dict[str, Any], shared: bool, own: Credentials | None
) -> zenoh.Config:
    """The configuration of a session: what all have in common, and `options`."""
    config = zenoh.Config()
    memory = _SHARED if shared else _UNSHARED
    settings = {"mode": mode, "metadata": {"name": name}, **_COMMON, **memory, **options}
    settings["transport/link/tx/lease"] = round(1000 * lease())
    if own is not None:
        settings["transport/link/tls"] = tls_settings(own)
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


# --- clock and threads ---

DIAGNOSIS_SECONDS: Final = 2.0


Ended = TypeVar("Ended")


class Timer(Protocol):
    """A pending call, or a repeated one."""

    def cancel(self) -> None:
        """Make no further call."""
        ...

    def join(self) -> None:
        """Wait until the last call has returned."""
        ...


class System:
    """A clock, threads and sessions, of the operating system and of Zenoh; times are in seconds."""

    # Not a method of its own: each frame reads the clock six times.
    monotonic = staticmethod(time.monotonic)

    def time(self) -> float:
        """Time since 1970."""
        return time.time()

    def sleep(self, seconds: float) -> None:
        """Block the calling thread."""
        time.sleep(seconds)

    def later(self, seconds: float, call: Callable[[], object]) -> Timer:
        """Call once after a delay, in a thread."""
        timer = threading.Timer(seconds, call)
        # A pending timer must not delay the end of the process.
        timer.daemon = True
        timer.start()
        return timer

    def every(self, seconds: float, call: Callable[[], object]) -> Timer:
        """Call at intervals, in a thread."""
        return _Repeated(seconds, call)

    def aside(self, call: Callable[[], object]) -> None:
        """Call now, in a thread."""
        threading.Thread(target=call, daemon=True).start()

    def open_hub(
        self,
        name: str,
        listen: str,
        *,
        shared: bool = False,
        secured: Secured | None = None,
        routers: Sequence[str] = (),
    ) -> tuple[zenoh.Session, str]:
        """A coordinator's session and its endpoint. Raises BusError."""
        return open_hub(name, listen, shared=shared, secured=secured, routers=routers)

    @contextmanager
    def client(
        self, name: str, endpoint: str, *, shared: bool, own: Credentials | None
    ) -> Generator[zenoh.Session]:
        """A member's session, as a context that closes it. Raises BusError."""
        session = open_client(name, endpoint, shared=shared, own=own)
        with closed_in_time(session):
            yield session

    def obstacle(self, endpoint: str, own: Credentials | None) -> str:
        """Reason why an endpoint is unreachable; blocks for DIAGNOSIS_SECONDS at most."""
        return obstacle(check_endpoint(endpoint), own, DIAGNOSIS_SECONDS)


class _Repeated:
    """A thread that calls at intervals."""

    def __init__(self, seconds: float, call: Callable[[], object]) -> None:
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(seconds, call), daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        self._stop.set()

    def join(self) -> None:
        self._thread.join()

    def _run(self, seconds: float, call: Callable[[], object]) -> None:
        while not self._stop.wait(seconds):
            call()


REAL: Final = System()


def run_through(life: Generator[None, None, Ended]) -> Ended:
    """Run all iterations of a process; returns its result."""
    try:
        while True:
            next(life)
    except StopIteration as end:
        return end.value
    finally:
        life.close()
