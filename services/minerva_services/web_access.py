"""Access control of everything that listens for HTTP: /metrics, pages, the Foxglove view, MCP.

Pages of other sites run in the same browser and can connect to this machine. Two checks keep them
out: `Host` must be a name of this server (a foreign name resolved to this machine is rejected), and
`Origin`, where a browser sends it, must be the server's own (RFC 6454). A server that acts on the
world has a token, too, which every request needs: in its address, as a bearer token (RFC 6750), or
in a cookie that other sites cannot use.
"""

from __future__ import annotations

import hmac
import ipaddress
import os
import secrets
import socket
from contextlib import suppress
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Final, Protocol
from urllib.parse import parse_qs, urlsplit

from minerva_bus.errors import MinervaError
from minerva_bus.files import open_itself
from minerva_bus.launch.registry import make_runtime_folder, runtime_folder
from minerva_bus.runtime.endpoints import is_wildcard

_LOCAL: Final = frozenset(("localhost", "127.0.0.1", "::1"))
# 144 bits, too many to be guessed.
_TOKEN_BYTES: Final = 18


class RequestHeaders(Protocol):
    """The headers of a request, as each server's library has them."""

    def get(self, name: str, default: str, /) -> str:
        """The value of a header; its name in upper or lower case."""
        ...


@dataclass(frozen=True, slots=True)
class WebAccess:
    """The names by which a server may be reached, and its token; "": it only reads.

    `host` is the listening address. If that is a wildcard, any address and the machine's name are
    accepted; `names` are additional ones, such as a proxy's. `origins` are other sites whose pages
    may connect. With `encrypted`, browsers send the cookie over TLS only.
    """

    host: str
    port: int
    token: str = ""
    names: frozenset[str] = frozenset()
    encrypted: bool = False
    origins: frozenset[str] = frozenset()

    @property
    def cookie(self) -> str:
        """The cookie that readmits a browser; named by port, because cookies ignore ports."""
        secure = "; Secure" if self.encrypted else ""
        return f"{self._cookie_name}={self.token}; Path=/; HttpOnly; SameSite=Strict{secure}"

    @property
    def _cookie_name(self) -> str:
        return f"minerva-{self.port}"

    def refusal(self, path: str, headers: RequestHeaders) -> str:
        """Reason for rejecting a request, or an empty string. `path` includes the query."""
        host = headers.get("Host", "")
        if not self._is_own(_name_of(f"//{host}")):
            return f"this page is not known as {host[:100]!r}: use the address that was printed"
        origin = headers.get("Origin", "")
        # Not parsed, because it need not be an address.
        if origin and origin.partition("://")[2] != host and origin not in self.origins:
            return f"a page of {origin[:100]!r} may not use this page"
        if self.token and not any(map(self._is_token, self._given(path, headers))):
            return "the token is missing or wrong: open the whole address that was printed"
        return ""

    def _is_own(self, name: str) -> bool:
        if name in _LOCAL or name in self.names or name == self.host:
            return True
        # An address, unlike a foreign name, cannot be made to resolve to this machine.
        return is_wildcard(self.host) and (_is_address(name) or name == socket.gethostname())

    def _given(self, path: str, headers: RequestHeaders) -> tuple[str, ...]:
        """The tokens of a request."""
        bearer = headers.get("Authorization", "").removeprefix("Bearer ")
        return (*parse_qs(path.partition("?")[2]).get("token", ()), bearer, self._cookie(headers))

    def _is_token(self, given: str) -> bool:
        # In constant time, so that response times reveal nothing about the token.
        return hmac.compare_digest(given.encode(errors="replace"), self.token.encode())

    def _cookie(self, headers: RequestHeaders) -> str:
        try:
            cookie = SimpleCookie(headers.get("Cookie", "")).get(self._cookie_name)
        except CookieError:
            return ""
        return cookie.value if cookie is not None else ""


def _name_of(address: str) -> str:
    with suppress(ValueError):
        return urlsplit(address).hostname or ""
    return ""


def _is_address(name: str) -> bool:
    with suppress(ValueError):
        return bool(ipaddress.ip_address(name))
    return False


# --- tokens ---


def new_token() -> str:
    """A token that nobody can guess."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


def token_for(port: int, run: str = "") -> str:
    """The token of the page at a port; stable across restarts of its process.

    A browser that was admitted can thus reconnect. The token is stored in a file readable by this
    user only, until `forget_token`. `run` identifies a run, without spaces: each run has a token of
    its own.
    """
    new = new_token()
    try:
        path = _token_file(make_runtime_folder(), port)
        with os.fdopen(open_itself(path, os.O_RDWR | os.O_CREAT), "r+", encoding="utf-8") as file:
            kept_run, _, kept = file.read(200).strip().rpartition(" ")
            if kept and kept_run == run:
                return kept
            file.seek(0)
            file.truncate()
            file.write(f"{run} {new}".strip())
    except (OSError, ValueError, MinervaError):
        pass  # without the file, the token lasts until the process ends
    return new


def forget_token(port: int) -> None:
    """Remove the token of the page at a port, whose world has ended."""
    with suppress(OSError):
        _token_file(runtime_folder(), port).unlink(missing_ok=True)


def _token_file(folder: Path, port: int) -> Path:
    return folder / f"page-{port}.token"
