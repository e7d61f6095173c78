"""Zenoh sessions: the coordinator is the hub, every other member a client of it.

Loopback only and no discovery unless an endpoint says otherwise; no router, no daemon.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import json
import os
import socket
from typing import Any

import zenoh

from minerva_bus.errors import BusError

LOOPBACK = "tcp/127.0.0.1:0"

# A link's events come to the threads that have opened it (app) or accepted it (acc), which wake
# those that read (rx): two hand-overs for a message. Where they are the same it is one, and a
# client, which has one link, needs one of them only. Those that write (tx) stay by themselves, so
# that a link is kept alive whatever its readers do.
_HUB_THREADS = "(acc:(handover:rx))"
_CLIENT_THREADS = "(rx:(worker_threads:1),app:(handover:rx))"

_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "timestamping/enabled": False,
    "adminspace/enabled": True,
    "transport/link/tx/lease": 3000,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
}


POOL_BYTES = 64 * 1024 * 1024
_SHARED: dict[str, Any] = {
    "transport/shared_memory/enabled": True,
    "transport/shared_memory/mode": "init",
    "transport/shared_memory/transport_optimization": {
        "enabled": True,
        "pool_size": POOL_BYTES,
        "message_size_threshold": 1024 * 1024,
    },
}
_UNSHARED: dict[str, Any] = {"transport/shared_memory/enabled": False}


def open_hub(
    name: str, listen: str = LOOPBACK, *, shared: bool = False
) -> tuple[zenoh.Session, str]:
    """The coordinator's session and the endpoint at which members find it.

    `shared`: messages from a megabyte on go through shared memory to those who can do so too.
    Raises BusError where the endpoint cannot be listened to.
    """
    check_endpoint(listen)
    _check_port_free(listen)
    os.environ.setdefault("ZENOH_RUNTIME", _HUB_THREADS)
    options = {"listen/endpoints": [listen], "listen/exit_on_failure": True}
    config = _config("router", name, options, shared)
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise BusError(f"cannot listen at {listen}: {_short(error)}") from None
    return session, _listening_at(session, listen)


def _listening_at(session: zenoh.Session, listen: str) -> str:
    if not listen.endswith(":0"):
        return listen
    for reply in session.get(f"@/{session.zid()}/router", timeout=5.0):
        if reply.ok is not None:
            locators: list[str] = json.loads(reply.ok.payload.to_string())["locators"]
            kind = listen.split("/", 1)[0]
            found = [one for one in locators if one.startswith(kind)]
            if found:
                return found[0]
    raise BusError(f"the session at {listen} does not say where it listens")


def open_client(
    name: str, connect: str, patience: float = 5.0, *, shared: bool = False
) -> zenoh.Session:
    """A member's session; `shared` as for the hub.

    Raises BusError with what to check where nobody answers.
    """
    check_endpoint(connect)
    options: dict[str, Any] = {
        "connect/endpoints": [connect],
        "connect/timeout_ms": int(patience * 1000),
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 20,
            "period_max_ms": 500,
            "period_increase_factor": 1.5,
        },
    }
    os.environ.setdefault("ZENOH_RUNTIME", _CLIENT_THREADS)
    try:
        return zenoh.open(_config("client", name, options, shared))
    except zenoh.ZError:
        raise BusError(
            f"nobody answers at {connect} within {patience:g} s; is the world running"
            " (minerva list), and are address, port and protocol right?"
        ) from None


def _config(mode: str, name: str, options: dict[str, Any], shared: bool) -> zenoh.Config:
    config = zenoh.Config()
    memory = _SHARED if shared else _UNSHARED
    settings = {"mode": mode, "metadata": {"name": name}, **_COMMON, **memory, **options}
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def check_endpoint(endpoint: str) -> None:
    """Complain of what cannot be an endpoint. Raises BusError."""
    kind, _, address = endpoint.partition("/")
    if kind not in ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream") or not address:
        raise BusError(
            f"{endpoint!r} is no endpoint; expected tcp/HOST:PORT, tls/HOST:PORT, quic/HOST:PORT"
            " or unixsock-stream/PATH"
        )
    host, _, port = address.rpartition(":")
    if kind != "unixsock-stream" and (not host or not port.isdecimal() or int(port) > 65535):
        raise BusError(f"{endpoint!r} is no endpoint; expected {kind}/HOST:PORT")


def _check_port_free(endpoint: str) -> None:
    """Zenoh's own complaint about a port in use does not say so: ask the system first."""
    kind, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if kind != "tcp" or port == "0":
        return
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host.strip("[]"), int(port)))
        except OSError as error:
            raise BusError(
                f"cannot listen at {endpoint}: {error.strerror}; choose another port, or port 0"
                " for any that is free"
            ) from None


def _short(error: Exception) -> str:
    return str(error).split(" at ", 1)[0][:200]
