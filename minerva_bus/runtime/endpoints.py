"""Endpoints where sessions listen or connect, and why one is unreachable: DNS, port, route, keys.

Zenoh reports only a time-out. So after a failure, each step is tried separately.
"""

from __future__ import annotations

import errno
import ipaddress
import socket
from typing import Final

from minerva_bus.errors import BusError
from minerva_bus.security.credentials import SECURED, Credentials
from minerva_bus.values import fast_dataclass, text

_KINDS: Final = ("tcp", *SECURED, "udp", "ws", "unixsock-stream")
_PATH: Final = "unixsock-stream"


@fast_dataclass
class Endpoint:
    """A parsed endpoint; a socket in the file system has a path instead of host and port."""

    text: str
    kind: str
    host: str = ""
    port: int = 0
    path: str = ""

    @property
    def secured(self) -> bool:
        """Whether both sides authenticate with certificates."""
        return self.kind in SECURED

    @property
    def local(self) -> bool:
        """Whether it is reachable from this machine only."""
        if self.path or self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def wildcard(self) -> bool:
        """Whether it stands for all addresses of this machine."""
        return is_wildcard(self.host)

    def at(self, host: str, port: int) -> str:
        """The endpoint of this kind at another address."""
        return f"{self.kind}/{f'[{host}]' if ':' in host else host}:{port}"


def own_endpoint(listen: str, actual: str) -> str:
    """The endpoint for processes of this machine: a loopback address in place of a wildcard.

    `actual` is where the session listens, with its port.
    """
    asked = check_endpoint(listen)
    if not asked.wildcard:
        return actual
    return asked.at(loopback(asked.host), check_endpoint(actual).port)


def for_others(listen: str, own: str) -> str:
    """The endpoint at which a session listens, with the port of its `own_endpoint`."""
    asked = check_endpoint(listen)
    return asked.at(asked.host, check_endpoint(own).port) if asked.wildcard else own


def is_wildcard(host: str) -> bool:
    """Whether a host to listen at stands for all addresses of this machine."""
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return False


def loopback(wildcard: str) -> str:
    """The address for connections from this machine to a wildcard address."""
    if ":" not in wildcard:
        return "127.0.0.1"
    # [::] takes IPv4, too, and a machine may have IPv6 switched off: then it has no ::1.
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return "127.0.0.1"
    return "::1"


def check_endpoint(endpoint: str) -> Endpoint:
    """Parse an endpoint. Raises BusError if it is not one."""
    kind, _, address = text("an endpoint", endpoint).partition("/")
    if kind not in _KINDS or not address:
        raise BusError(
            f"{endpoint!r} is not an endpoint; expected tcp/HOST:PORT, tls/HOST:PORT,"
            " quic/HOST:PORT or unixsock-stream/PATH"
        )
    if kind == _PATH:
        return Endpoint(endpoint, kind, path=address)
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise BusError(f"{endpoint!r} is not an endpoint; expected {kind}/HOST:PORT")
    return Endpoint(endpoint, kind, host.strip("[]"), int(port))


def check_listening(endpoint: str, *, keys: bool, insecure: bool) -> None:
    """Reject an endpoint at which any process could join a world. Raises BusError."""
    asked = check_endpoint(endpoint)
    if asked.secured and not keys:
        raise BusError(
            f"{endpoint} needs keys: minerva keys init makes them, --keys FOLDER names them"
        )
    if not (asked.secured or asked.local or insecure):
        raise BusError(
            f"{endpoint} would admit anyone who can reach it, with all permissions; create keys"
            f" (minerva keys init) and listen at tls/{asked.host}:{asked.port} with --keys FOLDER,"
            " or insist with --insecure"
        )


def check_port_free(endpoint: Endpoint) -> None:
    """Check that a port is free, because Zenoh's error does not mention a port in use.

    Raises BusError.
    """
    if endpoint.kind not in ("tcp", "tls") or not endpoint.port:
        return
    family = socket.AF_INET6 if ":" in endpoint.host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        # Without this, a port whose last connections are in TIME_WAIT would seem to be in use.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((endpoint.host, endpoint.port))
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise BusError(
                f"cannot listen at {endpoint.text}: {why}; {_otherwise(error)}"
            ) from None


def _otherwise(error: OSError | UnicodeError) -> str:
    """Advice for a port that is not available."""
    if isinstance(error, socket.gaierror | UnicodeError) or error.errno == errno.EADDRNOTAVAIL:
        return "choose an address of this machine, or 0.0.0.0 for all that it has"
    return "choose another port, or port 0 for any that is free"


ALERT_WITHIN = 0.5
"""Seconds in which a server may reject a client's certificate: in TLS 1.3 the last step."""

_PROBED = ("tcp", "tls", "ws")
_TLS_HELLO = bytes.fromhex("16030100050100000100")
_FOREIGN = "your certificate is not of its authority; use keys of the world's own folder"
_ALERTS = {
    "CERTIFICATE_REQUIRED": "it requires a certificate (--keys FOLDER)",
    "CERTIFICATE_EXPIRED": "your certificate has expired (minerva keys issue NAME --renew)",
    "UNKNOWN_CA": _FOREIGN,
    "DECRYPT_ERROR": _FOREIGN,
    "BAD_CERTIFICATE": "it does not take your certificate",
}


# --- diagnosis ---


def check_reachable(endpoint: Endpoint, patience: float) -> None:
    """Check that a host exists and a process listens. Raises BusError."""
    if endpoint.path or endpoint.kind not in _PROBED:
        return
    with _connected(endpoint, patience):
        return


def _connected(endpoint: Endpoint, patience: float) -> socket.socket:
    text, host, port = endpoint.text, endpoint.host, endpoint.port
    try:
        return socket.create_connection((host, port), timeout=patience)
    except (socket.gaierror, UnicodeError):  # Labels that are empty or too long are not looked up.
        raise BusError(f"no answer at {text}: there is no host {host!r}; check the name"
                       " (or give its address)") from None  # fmt: skip
    except ConnectionRefusedError:
        raise BusError(
            f"no answer at {text}: nothing listens at port {port} of {host}; is the world"
            " running (minerva list), and is it this port?"
        ) from None
    except TimeoutError:
        raise BusError(
            f"no answer at {text} within {patience:g} s: {host} is off, or a firewall blocks"
            f" port {port}"
        ) from None
    except OSError as error:
        raise BusError(f"no answer at {text}: {error.strerror or error}; check the address"
                       " and the network") from None  # fmt: skip


def why_unreachable(endpoint: Endpoint, own: Credentials | None, patience: float) -> str:
    """Reason why no session could be opened at an endpoint.

    Raises BusError if there is no such host, or no process listens.
    """
    text = endpoint.text
    if endpoint.kind == "tls":
        return f"{text}: {_trouble_with_tls(endpoint, own, patience)}"
    check_reachable(endpoint, patience)
    if endpoint.kind == "tcp" and _speaks_tls(endpoint, patience):
        return f"{text} speaks TLS: connect to tls/{text.partition('/')[2]} with --keys FOLDER"
    return (
        f"no answer at {text} within {patience:g} s; is the world running (minerva list), and"
        " are address, port and protocol right?"
    )


def obstacle(endpoint: Endpoint, own: Credentials | None, patience: float) -> str:
    """Reason why this machine cannot reconnect to a world at an endpoint.

    Blocks for up to `patience` seconds and ALERT_WITHIN.
    """
    if endpoint.path or endpoint.kind not in _PROBED:
        return f"nothing comes from {endpoint.text}"
    try:
        check_reachable(endpoint, patience)
        trouble = _trouble_with_tls(endpoint, own, patience) if endpoint.kind == "tls" else ""
    except BusError as error:
        return str(error)
    # The TLS link itself works, so the port is the right one.
    if trouble in ("", _NO_ZENOH):
        return f"something listens at {endpoint.text}, but the world is not there{not_let_in(own)}"
    return f"{endpoint.text}: {trouble}"


def not_let_in(own: Credentials | None) -> str:
    """Another possible reason for no answer from a secured world, to end an error message."""
    if own is None:
        return ""
    return (
        f"; or it rejects {own.name}, whose certificate may have been revoked, or issued after the"
        " world began"
    )


def _trouble_with_tls(endpoint: Endpoint, own: Credentials | None, patience: float) -> str:
    import ssl  # Only a failure of a secured link needs it.

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    if own is not None:
        context.load_verify_locations(own.authority)
        context.load_cert_chain(own.certificate, own.key)
    accepted = False
    with _connected(endpoint, patience) as raw:
        try:
            with context.wrap_socket(raw, server_hostname=endpoint.host) as link:
                accepted = True
                # In TLS 1.3 the server checks the client's certificate
                # after the client's handshake is over.
                link.settimeout(ALERT_WITHIN)
                link.recv(1)
        except ssl.SSLCertVerificationError as error:
            return _unverified(endpoint.host, error.verify_message)
        except ssl.SSLError as error:
            reason = error.reason or ""
            known = [text for alert, text in _ALERTS.items() if reason.endswith(alert)]
            return f"it refuses TLS: {known[0] if known else reason or error}"
        except TimeoutError:
            return _NO_ZENOH if accepted else "it does not speak TLS; is it a tcp/ endpoint?"
        except OSError as error:
            return f"it breaks the TLS link off: {error.strerror or error}; does it speak TLS?"
    return _NO_ZENOH


_NO_ZENOH = "a process answers that is not a world; is it another version, or another program?"


def _unverified(host: str, what: str) -> str:
    if "ostname mismatch" in what or "IP address mismatch" in what:
        return (
            f"its certificate is not for {host!r}; connect to a name that it is for, or renew it"
            f" with all of its names: minerva keys issue coordinator --host {host},... --renew"
        )
    if "expired" in what:
        return "the coordinator's certificate has expired: minerva keys issue coordinator --renew"
    return f"its certificate is not of your authority ({what}); are these the world's keys?"


def _speaks_tls(endpoint: Endpoint, patience: float) -> bool:
    """Whether a server answers in TLS, if only with an alert."""
    with _connected(endpoint, patience) as link:
        # The hello is too short: only a TLS server answers it, with an alert.
        link.settimeout(ALERT_WITHIN)
        try:
            link.sendall(_TLS_HELLO)
            return link.recv(1) in (b"\x15", b"\x16")
        except OSError:
            return False
