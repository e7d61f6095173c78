"""The page device: pages in browsers that are members of the world themselves."""

from __future__ import annotations

import os
import ssl
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from minerva_bus.errors import MisuseError, RecordError
from minerva_bus.runtime.endpoints import is_wildcard
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import check_port, check_rate, event_types, names_in, require
from minerva_services.views.page.names import PageNames, read_joins
from minerva_services.views.page.people import PageOptions, People
from minerva_services.views.page.relay import check_relayed
from minerva_services.views.page.site import PageSite
from minerva_services.views.page_access import address_in_network, announce, listen, page_url
from minerva_services.views.window.order_types import check_named
from minerva_services.web_access import WebAccess, forget_token, token_for

if TYPE_CHECKING:
    from minerva_services.views.page.server import MemberPageServer

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


class MemberPage(Device):
    """Serves a page that joins the world in the browser: it draws, sends orders, and hosts agents.

    Args:
        host: the address to listen at; 0.0.0.0 for all addresses of this machine.
        port: the port; 0: the first free one from 8080.
        draws: visual event types, comma-separated; their views are drawn over each other in this
            order.
        rate: maximum views per second of each page.
        module: a JavaScript file; it exports further members that pages are, by name.
        joins: their names, separated by spaces. One page has a name at a time; a name NAME-* stands
            for one member of each page: NAME-1, NAME-2, ...
        certificate: a file in PEM with a certificate, for https.
        key: its private key; by default the file of that name with `.key`.
        names: additional host names of the page, comma-separated: a proxy's, for example.
        click: the event type sent by a tap on a text; "": the first whose only datum is a text.
        slide: the event type sent by the arrow keys; "": the first whose only datum is a number.
        beside: the record of another run; pages show where this run, recorded or replayed, parts
            from it.

    Raises MisuseError if websockets is not installed and for invalid options.

    """

    interactive = True

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        draws: str = "ePicture",
        rate: float = 15.0,
        module: str = "",
        joins: str = "",
        certificate: str = "",
        key: str = "",
        names: str = "",
        click: str = "",
        slide: str = "",
        beside: str = "",
    ) -> None:
        require("page", "websockets", "websockets", "page")
        check_port("page", port)
        check_rate("page", rate)
        self._options = PageOptions(event_types("page", draws), rate, click, slide, _record(beside))
        self._address = host, port
        self._module = _module(module, joins)
        self._tls = _tls(certificate, key)
        self._names = names_in(names)
        self._server: MemberPageServer | None = None
        self._pages = PageNames("page", read_joins(joins))

    def check(self, world: WorldInfo) -> None:
        check_named("page", world.vocabulary, self._options.click, self._options.slide)
        for name in self._options.draws:
            declared = world.vocabulary.events.get(name)
            if declared is None or not declared.visual:
                visual = [event.name for event in world.vocabulary.events.values() if event.visual]
                raise MisuseError(
                    f"page: draws is {name!r}, but the visual event types of {world.world} are"
                    f" {', '.join(visual) or 'none'}"
                )

    def joined(self, world: WorldInfo) -> None:
        from minerva_services.views.page.server import MemberPageServer, PageServices

        self.check(world)
        self._check_endpoint(world)
        self._ended = world.ended
        site = PageSite(self._module)
        people = People(world, self._options, self._pages, site)
        host, wanted = self._address

        def start(port: int) -> tuple[MemberPageServer, WebAccess] | None:
            access = self._access(host, port)
            services = PageServices(
                access, site, people, self._pages, world.world, world.endpoint, self._tls
            )
            server = MemberPageServer(services, _say)
            return (server, access) if server.start() else None

        self._server, access = listen("page", host, wanted, start)
        self._port = access.port
        announce(world, page_url(access), self._advice(access))

    def show(self, view: View) -> None:
        """Nothing: it draws no views itself, the pages do."""

    def report(self) -> Mapping[str, bool | int | float | str]:
        return {"pages": self._pages.count}

    def close(self) -> None:
        if self._server is not None:
            left = "this page's server has left the world"
            ended = self._ended()
            self._server.stop("the world has ended" if ended else left)
            self._server = None
            # Until then, a page that was admitted connects again if this process is restarted.
            if ended:
                forget_token(self._port)

    def _access(self, host: str, port: int) -> WebAccess:
        # The launcher runs as long as the world; a restarted server thus has the same token.
        token = token_for(port, str(os.getppid()))
        return WebAccess(host, port, token, frozenset(self._names), self._tls is not None)

    def _check_endpoint(self, world: WorldInfo) -> None:
        check_relayed(world.endpoint)
        is_secured = not world.endpoint.startswith("tcp/")
        if is_secured and self._tls is None and self._address[0] not in _LOOPBACK:
            raise MisuseError(
                "page: this world uses TLS, so a page for other machines does, too; set"
                " certificate=keys/coordinator.pem, or host=127.0.0.1"
            )

    def _advice(self, access: WebAccess) -> str:
        """How to open the page on a phone."""
        if not is_wildcard(access.host):
            return "for a phone: host=0.0.0.0" if access.host in _LOOPBACK else "also on a phone"
        address = address_in_network()
        if not address:
            return "on a phone: no network found; use this machine's address in place of 127.0.0.1"
        plain = "" if access.encrypted else " (not encrypted; sensors need certificate=)"
        return f"on a phone in the same network: {page_url(access, address)}{plain}"


def _module(module: str, joins: str) -> Path | None:
    """The file of the option `module`. Raises MisuseError."""
    if bool(module) != bool(joins.strip()):
        raise MisuseError(
            "page: module and joins go together: module=garden.js,joins=snails, where garden.js has"
            " `export default { snails: host([...]) }`"
        )
    if not module:
        return None
    path = Path(module)
    if path.suffix not in (".js", ".mjs") or not path.is_file():
        raise MisuseError(f"page: module is {module!r}, which is not a file with JavaScript")
    return path.resolve()


def _record(beside: str) -> str:
    """The path of the option `beside`. Raises MisuseError if there is no such record."""
    if not beside:
        return ""
    from minerva_bus.log.record import Record

    path = Path(beside).absolute()
    try:
        Record(path).close()
    except RecordError as error:
        raise MisuseError(f"page: beside is the record of another run: {error}") from None
    return str(path)


def _tls(certificate: str, key: str) -> ssl.SSLContext | None:
    if not certificate:
        return None
    key_file = key or str(Path(certificate).with_suffix(".key"))
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        context.load_cert_chain(certificate, key_file)
    except (OSError, ssl.SSLError) as error:
        raise MisuseError(
            f"page: certificate {certificate} with key {key_file} cannot be used:"
            f" {error.strerror or error}"
        ) from None
    return context


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
