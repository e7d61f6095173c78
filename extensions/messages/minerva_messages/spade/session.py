"""Connections of agents to an XMPP server; used by one thread."""

# slixmpp and SPADE leave most types open.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportMissingTypeStubs=false
from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from minerva_bus.grammar.events import Event
from minerva_services.bridging import SourceError

if TYPE_CHECKING:
    from spade.message import Message

CONNECT_SECONDS: Final = 15.0
POLL_SECONDS: Final = 0.05
CLOSE_SECONDS: Final = 1.0
EMPTY_BODY: Final = " "
"""Body of a message without content: SPADE does not deliver messages without a body."""


class XmppServer(NamedTuple):
    """Address of a server (port 0: by DNS), and its options."""

    host: str
    port: int
    verify: bool
    register: bool


class XmppMessage(NamedTuple):
    """A message as transmitted over XMPP."""

    sender: str
    to: str
    body: str
    thread: str
    metadata: Mapping[str, str]


class XmppSession:
    """The agents of some JIDs, connected to a server.

    `read` sends queued messages, and yields what `receive` makes of incoming ones. Raises
    SourceError, also on creation, if the server is unreachable or rejects an account.
    """

    def __init__(
        self,
        server: XmppServer,
        passwords: Mapping[str, str],
        outbox: deque[XmppMessage],
        receive: Callable[[XmppMessage], Event | None],
    ) -> None:
        # `_fail` reports what goes wrong; slixmpp would log every step of it.
        logging.getLogger("slixmpp").setLevel(logging.CRITICAL)
        self._outbox, self._receive = outbox, receive
        self._inbox: deque[XmppMessage] = deque()
        self._wrong = ""
        self._leaves = False
        self._loop = asyncio.new_event_loop()
        # slixmpp uses the current loop of the thread.
        asyncio.set_event_loop(self._loop)
        self._clients: dict[str, Any] = {}
        self._ready: set[str] = set()
        try:
            for jid, password in passwords.items():
                self._clients[jid] = self._client(server, jid, password)
            self._connect(server)
        except BaseException:
            self.close()
            raise

    def read(self, stop: threading.Event) -> Iterator[Event | None]:
        """Incoming messages until `stop` is set. Raises SourceError if the connection is lost."""
        while not stop.is_set():
            while self._outbox:
                self._send(self._outbox.popleft())
            self._turn(POLL_SECONDS)
            while self._inbox:
                yield self._receive(self._inbox.popleft())
            yield None

    def close(self) -> None:
        """Send queued messages and disconnect."""
        self._leaves = True
        if not self._wrong:
            while self._outbox:
                self._send(self._outbox.popleft())
        gone = [client.disconnect(wait=0.2) for client in self._clients.values()]
        if gone:
            self._loop.run_until_complete(asyncio.wait(gone, timeout=CLOSE_SECONDS))
        # slixmpp leaves tasks behind; the loop would warn of them when it is closed.
        left = asyncio.all_tasks(self._loop)
        for task in left:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
        self._loop.close()
        asyncio.set_event_loop(None)

    def _client(self, server: XmppServer, jid: str, password: str) -> Any:
        from spade.xmpp_client import XMPPClient

        client = XMPPClient(jid, password, server.verify, server.register)
        client.add_event_handler("session_start", lambda _: self._ready.add(jid))
        client.add_event_handler(
            "failed_all_auth", lambda _: self._fail(f"authentication of {jid} failed")
        )
        client.add_event_handler("connection_failed", lambda why: self._fail(f"{why}"))
        client.add_event_handler("disconnected", lambda _: self._fail(f"{jid} is disconnected"))
        client.add_event_handler("message", self._on_message)
        return client

    def _connect(self, server: XmppServer) -> None:
        for client in self._clients.values():
            client.connect(server.host or None, server.port or None)
        until = time.monotonic() + CONNECT_SECONDS
        while len(self._ready) < len(self._clients):
            self._turn(POLL_SECONDS)
            if time.monotonic() > until:
                missing = sorted(self._clients.keys() - self._ready)
                raise SourceError(f"spade: no session for {missing[0]} within the time limit")

    def _turn(self, seconds: float) -> None:
        self._loop.run_until_complete(asyncio.sleep(seconds))
        if self._wrong:
            raise SourceError(f"spade: the XMPP server is lost: {self._wrong}")

    def _fail(self, why: str) -> None:
        if not self._leaves:
            # The first reason is the cause; the disconnection that follows is not.
            self._wrong = self._wrong or why

    def _send(self, letter: XmppMessage) -> None:
        from spade.message import Message

        client = self._clients[letter.sender]
        body = letter.body or EMPTY_BODY
        message = Message(
            letter.to, letter.sender, body, letter.thread or None, dict(letter.metadata)
        )
        message.prepare(client).send()

    def _on_message(self, stanza: Any) -> None:
        from spade.message import Message

        # Errors that a server returns are message stanzas, too.
        if stanza["type"] not in ("chat", "normal"):
            return
        message: Message = Message.from_node(stanza)  # type: ignore[assignment]
        self._inbox.append(
            XmppMessage(
                str(message.sender),
                str(message.to),
                "" if message.body in (None, EMPTY_BODY) else message.body,
                message.thread or "",
                dict(message._metadata),
            )
        )
