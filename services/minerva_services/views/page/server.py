"""The server of pages: files over HTTP, and two WebSockets for each page, behind one check."""

from __future__ import annotations

import asyncio
import errno
import ssl
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import TYPE_CHECKING, Final
from urllib.parse import parse_qs

from minerva_bus.errors import MisuseError
from minerva_services.views.page.guard import BusGuard
from minerva_services.views.page.names import PageNames
from minerva_services.views.page.people import People
from minerva_services.views.page.relay import BATCH, relay
from minerva_services.views.page.site import PageSite
from minerva_services.views.page_access import silent_logger
from minerva_services.web_access import WebAccess

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

BUS, PEOPLE = "/bus", "/people"
MAX_LINKS: Final = 1000
_START_SECONDS = 10.0
_END_SECONDS = 1.0
# A page whose network is gone frees its number after these. Its names are free earlier, because
# the coordinator ends sessions after their lease.
_PING_SECONDS = 10.0
_PONG_SECONDS = 10.0
_BUFFER = 4 << 20
_MAX_LOGGED = 100


@dataclass(frozen=True, slots=True)
class PageServices:
    """The parts of a server: who may use it, its files, its users and the names that pages hold.

    `world` and `endpoint` are those of the bus. `tls` has the certificate; None for plain HTTP.
    """

    access: WebAccess
    site: PageSite
    people: People
    names: PageNames
    world: str
    endpoint: str
    tls: ssl.SSLContext | None = None


class MemberPageServer:
    """Serves pages in a thread of its own. `log` gets lines about rejected requests."""

    def __init__(self, services: PageServices, log: Callable[[str], None]) -> None:
        self._services = services
        self._log = log
        self._logged: set[str] = set()
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        self._why = ""
        self._ready = threading.Event()
        self._failure: Exception | None = None
        self._links = 0
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)

    def start(self) -> bool:
        """Listen; False if the port is in use. Raises MisuseError if that is impossible."""
        self._thread.start()
        self._ready.wait(_START_SECONDS)
        if isinstance(self._failure, OSError) and self._failure.errno == errno.EADDRINUSE:
            return False
        if self._failure is not None:
            raise MisuseError(f"page: cannot listen: {self._failure}")
        return True

    def stop(self, why: str) -> None:
        """Tell the pages why, and stop."""
        self._why = why
        with suppress(RuntimeError):  # the loop has failed before
            self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(2 * _END_SECONDS)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        except Exception as error:
            self._failure = error
            if self._ready.is_set():
                self._log(f"the server has failed: {error}")
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        from websockets.asyncio.server import serve

        services = self._services
        server = serve(
            self._link,
            services.access.host,
            services.access.port,
            ssl=services.tls,
            process_request=self._answer,
            compression=None,
            server_header=None,
            max_size=BATCH,
            write_limit=_BUFFER,
            ping_interval=_PING_SECONDS,
            ping_timeout=_PONG_SECONDS,
            close_timeout=_END_SECONDS,
            logger=silent_logger("minerva.page"),
        )
        async with server:
            self._ready.set()
            watching = asyncio.create_task(services.people.watch())
            await self._over.wait()
            watching.cancel()
            await services.people.end(self._why)

    # --- requests ---

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The response to a request; None if it opens a WebSocket."""
        services = self._services
        refusal = services.access.refusal(request.path, request.headers)
        if refusal:
            self._log_rejection(connection, refusal)
            return _response(connection, HTTPStatus.FORBIDDEN, refusal)
        path = _path_of(request)
        if path in (BUS, PEOPLE):
            return self._answer_link(connection, request)
        file = services.site.file(path)
        if file is None:
            return _response(connection, HTTPStatus.NOT_FOUND, "this page has no such file")
        response = connection.respond(HTTPStatus.OK, "")
        response.body = file.content
        del response.headers["Content-Length"], response.headers["Content-Type"]
        for name, value in {
            "Content-Length": str(len(file.content)),
            "Content-Type": file.media_type,
            "Content-Security-Policy": services.site.policy,
            "Set-Cookie": services.access.cookie,
            # A newer version of the package must not meet files of an older one.
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }.items():
            response.headers[name] = value
        return response

    def _answer_link(self, connection: ServerConnection, request: Request) -> Response | None:
        if self._links >= MAX_LINKS:
            return _response(connection, HTTPStatus.SERVICE_UNAVAILABLE, "there are too many pages")
        if _path_of(request) == PEOPLE:
            return None
        name = _name_in(request)
        objection = self._services.names.objection(name)
        if not objection:
            return None
        if name not in self._services.names.taken:
            self._log_rejection(connection, objection)
        return _response(connection, HTTPStatus.CONFLICT, objection)

    async def _link(self, connection: ServerConnection) -> None:
        """Serve a WebSocket."""
        request = connection.request
        if request is None:
            return
        self._links += 1
        try:
            if _path_of(request) == PEOPLE:
                await self._services.people.serve(connection)
            else:
                await self._relay(connection, _name_in(request))
        finally:
            self._links -= 1

    async def _relay(self, connection: ServerConnection, name: str) -> None:
        services = self._services
        # Between the answer and this call another page may have taken it.
        if services.names.objection(name):
            await connection.close(1008, "the name is taken")
            return
        with services.names.held(name):
            reason = await relay(connection, services.endpoint, BusGuard(services.world, name))
        if reason:
            self._log_rejection(connection, f"{name} is cut off: {reason}")

    def _log_rejection(self, connection: ServerConnection, reason: str) -> None:
        """Log a rejection, each once for each machine, and not without end."""
        address = connection.remote_address
        text = f"rejected {address[0] if address else 'a request'}: {reason}"
        if text not in self._logged and len(self._logged) < _MAX_LOGGED:
            self._logged.add(text)
            self._log(text)


def _path_of(request: Request) -> str:
    # Not parsed as an address, which a client's path need not be.
    return request.path.partition("?")[0]


def _name_in(request: Request) -> str:
    return next(iter(parse_qs(request.path.partition("?")[2]).get("name", ())), "")


def _response(connection: ServerConnection, status: HTTPStatus, text: str) -> Response:
    return connection.respond(status, f"{text}\n")
