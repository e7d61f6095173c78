"""Admission to a world: the coordinator's session, its links and the admission rules."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import re
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Final

import zenoh

from minerva_bus.errors import KeysError
from minerva_bus.runtime.admission_rules import MAX_NAMES, STRANGERS, AdmissionRules
from minerva_bus.runtime.endpoints import for_others
from minerva_bus.runtime.links import Linked, Links, cut, watched
from minerva_bus.runtime.session import LOOPBACK, Secured, listening_at
from minerva_bus.runtime.system import REAL, System
from minerva_bus.security.access import access_control
from minerva_bus.security.credentials import HUB, Credentials, Rights, rights_of
from minerva_bus.wire.keys import COORDINATOR, Keys, is_name
from minerva_bus.wire.message_limits import Limits

LOCAL_KIND: Final = "unixsock-stream"
LOOK_EVERY: Final = 0.5
NO_NAME: Final = "a member's name has up to 64 letters, digits and _ . ~ -"


@dataclass(frozen=True, slots=True)
class Security:
    """Security of a world: its credentials, the known certificates and the local endpoint.

    `stamp` changes when `rights` have to be read again; both may raise KeysError.
    """

    own: Credentials
    local: str
    rights: Callable[[], Mapping[str, Rights]]
    stamp: Callable[[], object]


@dataclass(frozen=True, slots=True)
class ListenConfig:
    """Listening options of a coordinator: endpoints, routers, shared memory and security.

    `shared`: large messages use shared memory. Without `security`, every member may join.
    """

    listen: str = LOOPBACK
    shared: bool = False
    routers: Sequence[str] = ()
    security: Security | None = None


class Admission:
    """Admission to one world. Without security every process may join.

    `say` logs a warning about a member. `listens_at` is the endpoint for other machines, set
    when the session opens.
    """

    def __init__(
        self,
        keys: Keys,
        limits: Limits,
        where: ListenConfig,
        say: Callable[[str, str], None],
        system: System = REAL,
    ) -> None:
        security = where.security
        self._open_hub = system.open_hub
        self._where = where
        self._keys = keys
        self._limits = limits
        self._say = say
        self._logged: set[tuple[str, str]] = set()
        self._links: Links | None = None
        self._leaving: Sequence[str] = ()
        self.listens_at = ""
        self._looked_at = 0.0
        self._rights: Mapping[str, Rights] = {} if security is None else security.rights()
        # Zenoh's access rules are fixed when the session opens, so
        # certificates issued later do not count.
        self._known = frozenset(self._rights)
        self._stamp = None if security is None else security.stamp()
        self.rules = AdmissionRules(
            limits, None if security is None else lambda: self._rights, system.monotonic
        )

    @contextmanager
    def session(self, put: Callable[[Any], None]) -> Generator[tuple[zenoh.Session, str]]:
        """The coordinator's session, and the endpoint for this machine. Raises BusError.

        `put` is called in any thread; the main thread passes the items to `notice`.
        """
        where, security = self._where, self._where.security
        shared, routers = where.shared, where.routers
        if security is None:
            session, endpoint = self._open_hub(
                COORDINATOR, where.listen, shared=shared, routers=routers
            )
            with session:
                self.listens_at = for_others(where.listen, endpoint)
                yield session, endpoint
            return
        # For investigations: what Zenoh drops is in its log alone, if RUST_LOG asks for it.
        zenoh.try_init_log_from_env()
        secured = Secured(security.own, security.local, self._access(), self._filters())
        session, endpoint = self._open_hub(
            COORDINATOR, where.listen, shared=shared, secured=secured, routers=routers
        )
        with session, watched(session, put) as self._links:
            # `endpoint` is the Unix socket for this machine; other
            # machines need the one they connect to.
            self.listens_at = listening_at(session, where.listen)
            self._log_admitted()
            yield session, endpoint

    def _access(self) -> Mapping[str, Any]:
        return access_control(self._keys, self._rights.values(), [LOCAL_KIND])

    def _filters(self) -> list[Mapping[str, Any]]:
        # Readings bypass the coordinator, so Zenoh has to enforce their size.
        return [
            {
                "id": "readings",
                "flows": ["ingress"],
                "messages": ["put"],
                "key_exprs": [f"{self._keys.base}/topic/**"],
                "size_limit": self._limits.message_bytes,
            }
        ]

    def _log_admitted(self) -> None:
        names = [
            holder.name
            for _, holder in sorted(self._rights.items())
            if not (holder.revoked or holder.may(HUB))
        ]
        shown = ", ".join(names) or "no one (minerva keys issue NAME --role ROLE)"
        self._say(COORDINATOR, f"listens at {self.listens_at}; admits {shown}")

    # --- links and rejections ---

    def notice(self, linked: Linked) -> None:
        """Process a new link."""
        name = linked.name
        # TLS accepts every certificate of the authority, but Zenoh's rules do not mention this one.
        # The member would be connected and receive nothing, without knowing why.
        if name not in self._known:
            self.rules.count(name)
            self._say_once(
                name,
                f"connected from {linked.address} with a certificate that was issued after the"
                " world began; it is valid from the next start on",
            )
        elif self._rights[name].revoked:
            self._cut(linked)

    def keeps_out(self, member: str) -> bool:
        """Whether all messages of a member are ignored; each is counted."""
        # A name from the key may contain anything; it must not get into keys, logs or tables.
        if not is_name(member):
            self._misnamed(member)
            return True
        if self.rules.shut_out(member):
            self.rules.count(member)
            return True
        return False

    def too_many(self, limit: int) -> None:
        """Count a member beyond the limit; log the first one."""
        self.rules.count(STRANGERS)
        text = f"{limit} members are present; further ones are not admitted"
        self._say_once(STRANGERS, text)

    def objection_to_question(self, who: str, orders: bool, question: object) -> str:
        """Reason for rejecting a question, which is counted and logged, or an empty string."""
        if who and not is_name(who):
            return self._misnamed(who)
        objection = self.rules.objection_to_question(who, orders, question)
        if objection:
            self.rules.count(who)
            self._say_once(who, f"question rejected: {objection}")
        return objection

    def _misnamed(self, who: str) -> str:
        """Count and log an invalid name; with certificates, only a family's member can use one."""
        family = rights_of(who, self._rights)
        known = STRANGERS if family is None else family.name
        self.rules.count(known)
        self._say_once(known, f"messages of a member are ignored: {NO_NAME}")
        return NO_NAME

    def look(self, now: float) -> list[str]:
        """Check for issued and revoked certificates; returns the newly revoked common names.

        Their links are cut in the next check. If they were cut now, the members would not receive
        the reason, and Zenoh would reconnect them repeatedly. A certificate that is no longer
        in the folder counts as revoked. `now` is the monotonic time in seconds; checks
        are at least LOOK_EVERY apart.
        """
        security = self._where.security
        if security is None or now < self._looked_at + LOOK_EVERY:
            return []
        self._looked_at = now
        for name in self._leaving:
            for linked in self._linked(name):
                self._cut(linked)
        before = self._revoked()
        self._read_again(security)
        self._leaving = sorted(self._revoked() - before)
        return list(self._leaving)

    def _revoked(self) -> set[str]:
        return {name for name, holder in self._rights.items() if holder.revoked}

    def _read_again(self, security: Security) -> None:
        try:
            # Read before the rights: a change between the two calls gives
            # another stamp in the next check.
            stamp = security.stamp()
            if stamp != self._stamp:
                gone = {
                    name: replace(holder, revoked=True) for name, holder in self._rights.items()
                }
                self._rights, self._stamp = {**gone, **security.rights()}, stamp
        # A folder that cannot be read must neither admit nor exclude a member.
        except (KeysError, OSError) as error:
            self._say_once(
                COORDINATOR, f"cannot read the keys; the previous ones stay valid: {error}"
            )

    def _cut(self, linked: Linked) -> None:
        self.rules.count(linked.name)
        if linked not in self._linked(linked.name):
            return  # The link has closed in the meantime.
        if cut(linked):
            done = "is cut"
        elif linked.shares_socket:
            done = "cannot be cut, but its messages are ignored"
        else:
            done = "has closed"  # Zenoh reports that with a delay.
        self._say_once(
            linked.name, f"its certificate was revoked; its link from {linked.address} {done}"
        )

    def _linked(self, name: str) -> Sequence[Linked]:
        return self._links.of(name) if self._links is not None else ()

    def _say_once(self, who: str, text: str) -> None:
        """Log a text once per member or family.

        Addresses and the names of a family's members do not count as differences.
        """
        rights = rights_of(who, self._rights)
        known = who if rights is None else rights.name
        what = (known, re.sub(r"from \S+", "", text).replace(who, known))
        # Without certificates, names are unlimited.
        if what not in self._logged and len(self._logged) < MAX_NAMES:
            self._logged.add(what)
            self._say(who, text)
