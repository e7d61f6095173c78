"""Access control of a page: only holders of its token may view it and send orders.

Pages of other sites run in the same browser and can connect to this machine. Three checks keep them
out: every request needs the token, from the address or from a cookie that other sites cannot use;
`Host` must be a name of this page (a foreign name resolved to this machine is rejected); and
`Origin`, where a browser sends it, must be this page's own (RFC 6454).
"""

from __future__ import annotations

import hmac
import ipaddress
import os
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

from minerva_bus.errors import MinervaError
from minerva_bus.launch.runtime_folder import make_runtime_folder
from minerva_bus.outputs import open_itself

_LOCAL: Final = frozenset(("localhost", "127.0.0.1", "::1"))
_WILDCARDS: Final = ("0.0.0.0", "::")  # noqa: S104
# 144 bits, too many to be guessed.
_TOKEN_BYTES: Final = 18


@dataclass(frozen=True, slots=True)
class PageAccess:
    """The token of a page, and the names by which it may be reached.

    `host` is the listening address. If that is a wildcard, any address and the machine's name are
    accepted; `names` are additional ones, such as a proxy's. With `encrypted`, browsers send the
    cookie over TLS only.
    """

    host: str
    port: int
    token: str
    names: frozenset[str] = frozenset()
    encrypted: bool = False

    @property
    def cookie(self) -> str:
        """The cookie that readmits a browser; named by port, because cookies ignore ports."""
        secure = "; Secure" if self.encrypted else ""
        return f"{self._cookie_name}={self.token}; Path=/; HttpOnly; SameSite=Strict{secure}"

    @property
    def _cookie_name(self) -> str:
        return f"minerva-{self.port}"

    def refusal(self, path: str, headers: Mapping[str, str]) -> str:
        """Reason for rejecting a request, or an empty string. `path` includes the query."""
        host = headers.get("Host", "")
        if not self._is_own(_name_of(f"//{host}")):
            return f"this page is not known as {host[:100]!r}: use the address that was printed"
        origin = headers.get("Origin", "")
        if origin and urlsplit(origin).netloc != host:
            return f"a page of {origin[:100]!r} may not use this page"
        given = (*parse_qs(urlsplit(path).query).get("token", ()), self._in_cookie(headers))
        # In constant time, so that response times reveal nothing about the token.
        if not any(hmac.compare_digest(token.encode(), self.token.encode()) for token in given):
            return "the token is missing or wrong: open the whole address that was printed"
        return ""

    def _is_own(self, name: str) -> bool:
        if name in _LOCAL or name in self.names or name == self.host:
            return True
        # An address, unlike a foreign name, cannot be made to resolve to this machine.
        return self.host in _WILDCARDS and (_is_address(name) or name == socket.gethostname())

    def _in_cookie(self, headers: Mapping[str, str]) -> str:
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


def token_for(port: int, run: str = "") -> str:
    """The token of the page at a port; stable across restarts of its process.

    A browser that was admitted can thus reconnect. The token is stored in a file readable by this
    user only. `run` identifies a run, without spaces: each run has a token of its own.
    """
    new = secrets.token_urlsafe(_TOKEN_BYTES)
    try:
        path = make_runtime_folder() / f"page-{port}.token"
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


# The wrapped function belongs to the whole process.
_patching = threading.Lock()


@contextmanager
def guarding(
    access: PageAccess,
    change: Callable[[Any], None],
    around: Callable[[Callable[[Any], Awaitable[None]]], Callable[[Any], Awaitable[None]]],
) -> Generator[None]:
    """While active, servers that start answer only requests that `access` permits.

    `change` is called with each answer and may change it; `around` returns what handles a
    connection instead of the server's own function.

    viser has no hook for access checks, so the function that it serves with is wrapped.
    """
    from websockets.asyncio import server as sockets

    original: Any = sockets.serve

    def serve(handler: Any, *given: Any, process_request: Any, **options: Any) -> Any:
        checked = _checked(access, process_request, change)
        return original(around(handler), *given, process_request=checked, **options)

    with _patching:
        sockets.serve = serve  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
        finally:
            sockets.serve = original


def _checked(
    access: PageAccess, answer: Callable[[Any, Any], Any], change: Callable[[Any], None]
) -> Callable[[Any, Any], Any]:
    from websockets import Headers
    from websockets.http11 import Response

    def process(connection: Any, request: Any) -> Any:
        refusal = access.refusal(request.path, request.headers)
        if refusal:
            headers = Headers({"Content-Type": "text/plain; charset=utf-8"})
            return Response(403, "Forbidden", headers, f"{refusal}\n".encode())
        response = answer(connection, request)
        if response is not None:
            change(response)
            response.headers["Set-Cookie"] = access.cookie
            # The address contains the token, which must not reach other sites.
            response.headers["Referrer-Policy"] = "no-referrer"
            # A foreign page must not show this one in a frame and lure its user to click there.
            response.headers["X-Frame-Options"] = "DENY"
        return response

    return process
