"""The SPADE bridge: messages to external agents are sent over XMPP, and theirs received."""

from __future__ import annotations

from collections import deque
from typing import Any, ClassVar, Final

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.semantics.geometry import interpret
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_messages import Outside, eMail, eMessage
from minerva_messages.spade.acl_messages import (
    Clock,
    InvalidMessage,
    Mail,
    Mailbox,
    event_of,
    metadata_of,
)
from minerva_messages.spade.addresses import Addresses
from minerva_messages.spade.session import XmppMessage, XmppServer, XmppSession
from minerva_services.bridging import Bridge
from minerva_services.event_factory import event_type
from minerva_services.options import read_password, require

MAX_QUEUED: Final = 10_000
"""Maximum number of messages that wait for the server; more are dropped."""


class Spade(
    Bridge, Device, events=("eMessage",), draws=("eMail",), when="freely, each frame", coupled=True
):
    """Connects `AOutside` agents with the external agents that they represent.

    Each agent of the world that external agents may address has an account on an XMPP server.

    Args:
        inside: ids of agents with accounts: a list, or a table with their JIDs.
        outside: JIDs of the agents that `AOutside` agents represent: a pattern with `{id}`, a list
          of ids or a table.
        domain: domain of JIDs that are not given.
        server: `HOST` or `HOST:PORT` of the XMPP server; by default looked up by the domain.
        password_env: environment variable with the accounts' password.
        password_file: file with the password.
        register: create the accounts, if the server permits it.
        verify: whether the server's certificate must be valid.

    """

    source_option: ClassVar[str] = "server"

    def __init__(
        self,
        inside: Any,
        outside: Any = "",
        domain: str = "",
        server: str = "",
        password_env: str = "",
        password_file: str = "",
        register: bool = False,
        verify: bool = True,
    ) -> None:
        super().__init__()
        self._inside = Addresses.of("inside", inside, domain)
        if not len(self._inside):
            raise MisuseError("spade: inside is empty; expected ids, or a table of ids and JIDs")
        self.concerns = tuple(self._inside)
        pattern = outside or (f"{{id}}@{domain}" if domain else "")
        if not pattern:
            raise MisuseError('spade: set outside, such as "{id}@example.org", or domain')
        self._outside = Addresses.of("outside", pattern, domain)
        self._server = XmppServer(*_place(server), verify, register)
        if bool(password_env) == bool(password_file):
            raise MisuseError("spade: set password_env or password_file")
        self._password_env, self._password_file = password_env, password_file
        self.source = f"spade: the XMPP server {server or domain}".rstrip()
        # Filled by the world's thread and emptied by that of the bridge: both ends of a deque are
        # atomic.
        self._outbox: deque[XmppMessage] = deque()
        self._sent: int | None = None  # the last frame whose messages are queued
        self._there: frozenset[str] = frozenset()
        self._reported: set[str] = set()

    def joined(self, world: WorldInfo) -> None:
        require("spade", "spade", "SPADE", "spade")
        # A missing password is reported here; in `open` it would be retried.
        self._password()
        self._world = world
        self._clock = Clock(0, world.dt)
        if event_type("spade", world, eMessage.name).fields != eMessage.fields:
            raise MisuseError("spade: the world declares a different eMessage; use *MESSAGES")
        if Outside.kind.name not in world.vocabulary.kinds or eMail.name not in world.vocabulary:
            raise MisuseError(
                f"spade: the world {world.world!r} has no external agents; its vocabulary needs"
                " *MESSAGES and *OUTSIDE of minerva_messages"
            )

    # --- outgoing ---

    def show(self, view: View) -> None:
        """Queue new messages to external agents (α of `PMail`)."""
        mailbox = Mailbox()
        interpret(view.scene, mailbox)
        self._clock = Clock(view.frame, self._world.dt)
        self._outside.add_ids(mailbox.there)
        self._there = frozenset(mailbox.there)
        for mail in mailbox.mail:
            # An agent keeps its mail until it receives more, so views repeat messages that have
            # been sent. To a new bridge, only the mail of the previous frame is new.
            if mail.frame > (view.frame - 2 if self._sent is None else self._sent):
                self._post(mail)
        self._sent = view.frame - 1

    def _post(self, mail: Mail) -> None:
        sender, to = self._inside.jid(mail.sender), self._outside.jid(mail.to)
        if not sender or not to:
            lacks = f"#{mail.to} has no address" if sender else f"#{mail.sender} has no account"
            self._report("unsent", f"{lacks}, so a message to #{mail.to} is not sent")
        elif len(self._outbox) >= MAX_QUEUED:
            self._report("dropped", f"{MAX_QUEUED} messages wait for the server; more are dropped")
        else:
            given = mail.parameters
            metadata = metadata_of(given, (self._inside, self._outside), self._clock)
            self._outbox.append(
                XmppMessage(sender, to, given["content"], given["conversation_id"], metadata)
            )
            self.count("sent")

    # --- incoming ---

    def open(self) -> XmppSession:
        passwords = {self._inside.jid(id): self._password() for id in self._inside}
        return XmppSession(self._server, passwords, self._outbox, self._receive)

    def _receive(self, letter: XmppMessage) -> Event | None:
        sender, receiver = self._outside.id(letter.sender), self._inside.id(letter.to)
        # Anybody can write to an XMPP account; only agents that the world shows may send events.
        if sender not in self._there or not receiver:
            self._report("strangers", f"{letter.sender} has no AOutside agent")
            return None
        known = (self._inside, self._outside)
        try:
            return event_of(
                letter.body, letter.thread, letter.metadata, sender, receiver, known, self._clock
            )
        except (InvalidMessage, MinervaError) as problem:
            self._report("garbage", f"{letter.sender}: {problem}")
            return None

    def _report(self, what: str, problem: str) -> None:
        """Count a problem, and log the first of its kind."""
        self.count(what)
        if what not in self._reported:
            self._reported.add(what)
            self._log(f"spade: {problem}; further ones are counted as {what!r}")

    def _password(self) -> str:
        return read_password("spade", self._password_env, self._password_file)


def _place(server: str) -> tuple[str, int]:
    """Parse `HOST[:PORT]`. Raises MisuseError."""
    host, colon, port = server.partition(":")
    if colon and not (port.isdecimal() and 0 < int(port) < 65536):
        raise MisuseError(f"spade: server is {server!r}; expected HOST or HOST:PORT")
    return host, int(port) if colon else 5222 if host else 0
