"""The SPADE bridge: messages to agents outside go out over XMPP, and theirs come in."""

from __future__ import annotations

import os
from collections import deque
from pathlib import Path
from typing import Any, ClassVar, Final

from minerva_bus.acl import Outside, eMail, eMessage
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.semantics.geometry import interpret
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.bridges.spade.addresses import Addresses
from minerva_services.bridges.spade.mail import Clock, Garbage, Mail, Mailbox, event_of, metadata_of
from minerva_services.bridges.spade.session import Letter, Server, Session, check_library
from minerva_services.bridging import Bridge
from minerva_services.event_factory import event_type

WAITING: Final = 10_000
"""Messages that wait for the server, at most; more are dropped."""


class Spade(Bridge, Device, events=("eMessage",), draws=("eMail",), lockstep=False, coupled=True):
    """Agents outside hear what `AOutside` agents are told, and speak in their names.

    Each agent inside that shall be heard outside has an account on an XMPP server.

    Args:
        inside: the ids of agents that have accounts: a list, or a table with their JIDs.
        outside: the JIDs of those that `AOutside` agents stand for: a pattern with `{id}` in it,
            a list of ids or a table.
        domain: of the JIDs that are not told.
        server: `HOST` or `HOST:PORT` of the XMPP server; else it is looked up by the domain.
        password_env: the environment variable with the accounts' password.
        password_file: the file that has it.
        register: make the accounts, where the server lets us.
        verify: whether the server's certificate must be valid.

    """

    source_option: ClassVar[str] = "server"
    every = 1

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
            raise MisuseError("spade: inside names nobody; give ids, or a table of ids and JIDs")
        pattern = outside or (f"{{id}}@{domain}" if domain else "")
        if not pattern:
            raise MisuseError('spade: give outside, such as "{id}@example.org", or domain')
        self._outside = Addresses.of("outside", pattern, domain)
        self._server = Server(*_place(server), verify, register)
        if bool(password_env) == bool(password_file):
            raise MisuseError("spade: give password_env or password_file")
        self._password_env, self._password_file = password_env, password_file
        self.source = f"spade: the XMPP server {server or domain}".rstrip()
        self._outbox: deque[Letter] = deque()
        self._sent: int | None = None  # Up to this frame all has been put on its way.
        self._there: frozenset[str] = frozenset()
        self._complained: set[str] = set()

    def joined(self, world: WorldInfo) -> None:
        check_library()
        self._password()
        self._world = world
        self._clock = Clock(0, world.dt)
        if event_type("spade", world, eMessage.name).fields != eMessage.fields:
            raise MisuseError("spade: the world's eMessage is another one; take in *MESSAGES")
        if Outside.kind.name not in world.vocabulary.kinds or eMail.name not in world.vocabulary:
            raise MisuseError(
                f"spade: nobody can be outside of the world {world.world!r}; its vocabulary needs"
                " *MESSAGES and *OUTSIDE of minerva_bus.acl"
            )

    # --- out ---

    def show(self, view: View) -> None:
        """Put what agents outside have been told on its way (α of `PMail`)."""
        mailbox = Mailbox()
        interpret(view.scene, mailbox)
        self._clock = Clock(view.frame, self._world.dt)
        self._outside.meet(mailbox.there)
        self._there = frozenset(mailbox.there)
        for mail in mailbox.mail:
            if mail.frame > (view.frame - 2 if self._sent is None else self._sent):
                self._post(mail)
        self._sent = view.frame - 1

    def _post(self, mail: Mail) -> None:
        sender, to = self._inside.jid(mail.sender), self._outside.jid(mail.to)
        if not sender or not to:
            lacks = f"#{mail.to} has no address" if sender else f"#{mail.sender} is not inside"
            self._complain("unsent", f"{lacks}, so a message to #{mail.to} is not sent")
        elif len(self._outbox) >= WAITING:
            self._complain("dropped", f"{WAITING} messages wait for the server; more are dropped")
        else:
            given = mail.parameters
            metadata = metadata_of(given, (self._inside, self._outside), self._clock)
            self._outbox.append(
                Letter(sender, to, given["content"], given["conversation_id"], metadata)
            )
            self.count("sent")

    # --- in ---

    def open(self) -> Session:
        passwords = {self._inside.jid(id): self._password() for id in self._inside}
        return Session(self._server, passwords, self._outbox, self._receive)

    def _receive(self, letter: Letter) -> Event | None:
        sender, receiver = self._outside.id(letter.sender), self._inside.id(letter.to)
        if sender not in self._there or not receiver:
            self._complain("strangers", f"{letter.sender} writes, for whom no AOutside stands")
            return None
        known = (self._inside, self._outside)
        try:
            return event_of(
                letter.body, letter.thread, letter.metadata, sender, receiver, known, self._clock
            )
        except (Garbage, MinervaError) as garbage:
            self._complain("garbage", f"{letter.sender}: {garbage}")
            return None

    def _complain(self, what: str, problem: str) -> None:
        """Count it, and say it once of its sort."""
        self.count(what)
        if what not in self._complained:
            self._complained.add(what)
            self._say(f"spade: {problem}; further ones are counted as {what!r}")

    def _password(self) -> str:
        if self._password_env:
            found = os.environ.get(self._password_env)
            if found is None:
                raise MisuseError(f"spade: the environment has no {self._password_env}; set it")
            return found
        try:
            return Path(self._password_file).read_text(encoding="utf-8").rstrip("\r\n")
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "no text in UTF-8"
            raise MisuseError(f"spade: password_file {self._password_file}: {reason}") from None


def _place(server: str) -> tuple[str, int]:
    """Host and port of `HOST[:PORT]`. Raises MisuseError."""
    host, colon, port = server.partition(":")
    if colon and not (port.isdecimal() and 0 < int(port) < 65536):
        raise MisuseError(f"spade: server is {server!r}; expected HOST or HOST:PORT")
    return host, int(port) if colon else 5222 if host else 0
