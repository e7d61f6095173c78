"""Access control of a server that has no hook for it: viser's, in the view `web`."""

from __future__ import annotations

import logging
import threading
from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager
from typing import Any

from minerva_bus.launch.web_access import WebAccess


def silent_logger(name: str) -> logging.Logger:
    """A logger for a server of pages, whose clients' errors are not errors of the world."""
    quiet = logging.getLogger(name)
    quiet.setLevel(logging.CRITICAL)
    return quiet


# The wrapped function belongs to the whole process.
_patching = threading.Lock()


@contextmanager
def guarding(
    access: WebAccess,
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
    quiet = silent_logger("minerva.web")

    def serve(handler: Any, *given: Any, process_request: Any, **options: Any) -> Any:
        checked = _checked(access, process_request, change)
        options["logger"] = quiet
        return original(around(handler), *given, process_request=checked, **options)

    with _patching:
        sockets.serve = serve  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
        finally:
            sockets.serve = original


def _checked(
    access: WebAccess, answer: Callable[[Any, Any], Any], change: Callable[[Any], None]
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
