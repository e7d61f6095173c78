"""Admission to a world: the coordinator's session, its links, and the admission rules.

Zenoh's access control binds each key to a certificate, so the key identifies the sender. Roles and
limits are checked here. All rejections are counted by name.

That control is fixed when a session opens, and does not check revocation. So each new link is
checked, and all links again when a certificate is revoked. Zenoh cannot close a single link, but
its socket belongs to this process.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import re
import socket
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from minerva_bus.errors import KeysError
from minerva_bus.frame.messages import Hello
from minerva_bus.runtime.endpoints import for_others
from minerva_bus.runtime.session import LOOPBACK, REAL, Secured, System, listening_at, sockets_to
from minerva_bus.security.access import access_control
from minerva_bus.security.credentials import (
    AGENT,
    GENERATOR,
    HUB,
    OPERATOR,
    VIEW,
    Credentials,
    Rights,
    rights_of,
)
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.keys import COORDINATOR, Keys, is_name
from minerva_bus.wire.plain import DEFAULT, Limits, values_in

# --- secured links, with the names of their certificates ---


@fast_dataclass
class Linked:
    """A link with a certificate of this name, from this address."""

    name: str
    address: str

    @property
    def shares_socket(self) -> bool:
        """Whether the link has no socket of its own."""
        return self.address.startswith("quic/")


class Links:
    """The secured links of a session. `notify` is called in threads of Zenoh for each new one."""

    def __init__(self, session: zenoh.Session, notify: Callable[[Linked], None]) -> None:
        self._notify = notify
        self._linked: dict[str, Linked] = {}
        # With history, because links may exist before the listener is declared.
        self._listener: Any = session.info.declare_link_events_listener(
            Callback(self._on_event, indirect=True), history=True
        )

    def close(self) -> None:
        """Stop watching."""
        self._listener.undeclare()

    def _on_event(self, event: Any) -> None:
        name, address = event.link.auth_identifier, str(event.link.dst)
        # A link within this machine has no certificate.
        if name is None:
            return
        if event.kind == zenoh.SampleKind.PUT:
            self._linked[address] = Linked(str(name), address)
            self._notify(self._linked[address])
        else:
            self._linked.pop(address, None)

    def of(self, name: str) -> list[Linked]:
        """The links of a name."""
        # A copy, because threads of Zenoh may add links during the iteration.
        return [linked for linked in list(self._linked.values()) if linked.name == name]


def cut(linked: Linked) -> bool:
    """Shut down a link's socket; False if it has none: it shares one, or has closed."""
    for connection in sockets_to(linked.address):
        with suppress(OSError):
            # Not `close`: this is a copy of Zenoh's descriptor, and
            # closing it would leave the link open.
            connection.shutdown(socket.SHUT_RDWR)
            return True
    return False


READING: Final = frozenset(
    {"status", "totals", "series", "scene", "fragment", "vocabulary", "logs", "orders"}
)
"""Questions that do not change the world."""

FOR_ALL: Final = frozenset({"status"})
STRANGERS: Final = "strangers"
GUESTS: Final = "~guests"
"""Whose buckets the tokens of all that take no part share."""

MAX_NAMES: Final = 1000
"""Maximum number of names counted separately: without certificates, names are unlimited."""

_MOMENT: Final = 0.001
_MESSAGES, _BYTES, _VALUES = "messages", "bytes", "values"
_SECONDS, _HELLOS, _ALL = "seconds", "hellos", "hellos of all"
_TOKENS, _ALL_TOKENS = "tokens", "tokens of all"


class _Allowance:
    """Token buckets of one sender; each holds up to one second's worth. Last filled `at`."""

    def __init__(self, full: Mapping[str, float], now: float) -> None:
        self._full = full
        self._left = dict(full)
        self.at = now
        self.logged = False

    def fill(self, now: float) -> None:
        """Refill the buckets for the time that has passed."""
        passed = now - self.at
        if passed < _MOMENT:
            return  # In a flood, refilling would cost more than everything else.
        self.at = now
        for what, full in self._full.items():
            # Capped at one second's worth, so that an idle member cannot
            # send an unlimited burst.
            left = self._left[what] + passed * full
            self._left[what] = left if left < full else full

    def left(self, what: str) -> float:
        """Amount left in a bucket."""
        return self._left[what]

    def take(self, what: str, amount: float) -> bool:
        """Take an amount; if less is left, empty the bucket and return False."""
        left = self._left[what] - amount
        self._left[what] = max(left, 0.0)
        return left >= 0

    def owe(self, what: str, amount: float) -> None:
        """Take an amount even if that leaves a debt."""
        self._left[what] -= amount


class AdmissionRules:
    """Rules of one world.

    `rights` returns what certificates allow, by common name; without it everything is allowed.
    """

    def __init__(
        self,
        limits: Limits = DEFAULT,
        rights: Callable[[], Mapping[str, Rights]] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.refused: Counter[str] = Counter()
        self._limits = limits
        self._rights = rights
        self._clock = clock
        self._allowances: dict[str, _Allowance] = {}
        self._full: Mapping[str, float] = {
            _MESSAGES: limits.messages,
            _BYTES: limits.bytes,
            _VALUES: limits.values,
            _SECONDS: limits.seconds,
            _HELLOS: limits.hellos,
            _ALL: limits.all_hellos,
            _TOKENS: limits.hellos,
            _ALL_TOKENS: limits.all_hellos,
        }
        of_strangers = min(limits.messages, limits.stranger_messages)
        self._full_of_strangers = {**self._full, _MESSAGES: of_strangers}

    def count(self, who: str, number: int = 1) -> None:
        """Count rejections of a sender."""
        known = who in self.refused or len(self.refused) < MAX_NAMES
        self.refused[who if known else STRANGERS] += number

    def counts(self) -> dict[str, int]:
        """The number of rejections by name."""
        return dict(sorted(self.refused.items()))

    # --- limits ---

    def has_room(self, who: str, size: int) -> bool:
        """Whether a message of this many bytes is within the limits per second."""
        own = self._filled(who)
        if not own.take(_MESSAGES, 1):
            return False
        # Time is charged after the work, so this bucket may be in debt;
        # nothing passes until it is paid.
        return own.take(_BYTES, size) and own.left(_SECONDS) > 0

    def has_values(self, who: str, data: bytes) -> bool:
        """Whether the number of values of a message is within the limits per second.

        A message above the limit per message passes, so that the decoder rejects it with a reason.
        """
        # Counting takes time itself, so the count stops at the sender's remaining allowance.
        own, most = self._filled(who), self._limits.values
        left = int(own.left(_VALUES))
        count = values_in(data, left if 2 * left < most else most)
        return own.take(_VALUES, count) or count > most

    def has_hello(self, who: str) -> bool:
        """Whether another hello is within the limits per second, per sender and in total."""
        # The sender's own bucket is first: a flood from one
        # sender must not empty the common one.
        return self._filled(who).take(_HELLOS, 1) and self._filled(_ALL).take(_ALL, 1)

    def has_token(self, who: str, takes_part: bool) -> bool:
        """Whether a change of a member's token is within the limits per second.

        Names are unlimited, so all that take no part have common limits as well.
        """
        own = self._filled(who)
        if takes_part:
            return own.take(_TOKENS, 1)
        common = self._filled(GUESTS)
        if common.left(_SECONDS) <= 0 or common.left(_ALL_TOKENS) < 1:
            return False
        return own.take(_TOKENS, 1) and common.take(_ALL_TOKENS, 1)

    def spent(self, who: str, seconds: float) -> None:
        """Charge the seconds that processing a message took."""
        self._filled(who).owe(_SECONDS, seconds)

    def _filled(self, who: str) -> _Allowance:
        """The refilled buckets of a sender."""
        own = self._allowances.get(who)
        if own is None:
            if len(self._allowances) >= self._limits.members + MAX_NAMES:
                self._forget()
            full = self._full if who != STRANGERS else self._full_of_strangers
            own = self._allowances[who] = _Allowance(full, self._clock())
        own.fill(self._clock())
        return own

    def _forget(self) -> None:
        """Forget the senders of longest ago: without certificates, names are unlimited."""
        latest = sorted(self._allowances.items(), key=lambda entry: entry[1].at)
        self._allowances = dict(latest[MAX_NAMES:])

    def too_much(self, who: str, number: int = 1) -> str:
        """Count messages or tokens above the limits; the warning for the first, "" after that."""
        self.count(who, number)
        own, limits = self._filled(who), self._limits
        if own.logged:
            return ""
        own.logged = True
        if who == STRANGERS:
            return (
                f"unknown senders send more than {limits.stranger_messages} messages per second,"
                " or their tokens come and go too fast; the rest is only counted"
            )
        return (
            f"sends more than {limits.messages} messages, {limits.hellos} hellos or tokens,"
            f" {limits.bytes >> 20} MiB or {limits.values} values per second, or messages that take"
            f" {limits.seconds:g} s; the rest is dropped (columns are few values; [limits])"
        )

    # --- roles ---

    def shut_out(self, who: str) -> str:
        """Reason for ignoring all messages of a member, or an empty string."""
        own = self._of(who)
        return "its certificate was revoked" if own is not None and own.revoked else ""

    def objection(self, hello: Hello) -> str:
        """Reason why a certificate does not allow the roles in a hello, or an empty string."""
        own = self._of(hello.member)
        if own is None:
            return ""
        if own.revoked:
            return self.shut_out(hello.member)
        makes = hello.generates or hello.publishes or hello.orders or hello.ticks
        kinds = [kind.name for kind in hello.kinds]
        faces = ((AGENT, kinds), (GENERATOR, makes), (VIEW, hello.draws))
        for role, shown in faces:
            if shown and not own.may(role):
                roles = ", ".join(sorted(own.roles))
                return f"its certificate is for {roles}, not for {role}"
        return (
            _beyond("agents", kinds, own.kinds)
            or _beyond("events", hello.generates, own.events)
            or _beyond("topics", hello.publishes, own.topics, explicit=True)
        )

    def objection_to_question(self, who: str, orders: bool, question: object) -> str:
        """Reason for rejecting a question, or an empty string.

        `who` is the name of the certificate, empty for a process of this machine. `orders`: the
        question arrived on the key that also accepts commands.
        """
        if not orders and question not in READING:
            return f"{who} may not send commands: its certificate lacks the role {OPERATOR}"
        own = self._of(who) if who else None
        if own is None:
            return ""
        if own.revoked:
            return f"the certificate of {who} was revoked"
        if question in READING and not (own.may(VIEW, OPERATOR) or question in FOR_ALL):
            return f"{who} may not read the world: its certificate has no role {VIEW} or {OPERATOR}"
        if question not in READING and not own.may(OPERATOR):
            return f"{who} may not send commands: its certificate lacks the role {OPERATOR}"
        return ""

    def _of(self, who: str) -> Rights | None:
        return rights_of(who, self._rights()) if self._rights is not None else None


def _beyond(
    what: str, shown: tuple[str, ...] | list[str], confined: frozenset[str], explicit: bool = False
) -> str:
    """Why a certificate does not allow what is shown; `explicit`: only what it lists."""
    beyond = sorted(set(shown) - confined) if confined or explicit else []
    if not beyond:
        return ""
    if not confined:
        return (
            f"its certificate is for no {what}, not for {', '.join(beyond)} (keys issue --{what})"
        )
    allowed = ", ".join(sorted(confined))
    return f"its certificate is for the {what} {allowed}, not for {', '.join(beyond)}"


LOCAL_KIND: Final = "unixsock-stream"
LOOK_EVERY: Final = 0.5
NO_NAME: Final = "a member's name has up to 64 letters, digits and _ . ~ -"


@fast_dataclass
class Security:
    """Security of a world: its credentials, the known certificates and the local endpoint.

    `stamp` changes when `rights` have to be read again; both may raise KeysError.
    """

    own: Credentials
    local: str
    rights: Callable[[], Mapping[str, Rights]]
    stamp: Callable[[], object]


@fast_dataclass
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
        access = access_control(self._keys, self._rights.values(), [LOCAL_KIND])
        secured = Secured(security.own, security.local, access, self._filters())
        session, endpoint = self._open_hub(
            COORDINATOR, where.listen, shared=shared, secured=secured, routers=routers
        )
        with session, closing(Links(session, put)) as self._links:
            # `endpoint` is the Unix socket for this machine; other
            # machines need the one they connect to.
            self.listens_at = listening_at(session, where.listen)
            self._log_admitted()
            yield session, endpoint

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
