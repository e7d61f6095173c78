"""The key space of the bus: section 2 of PROTOCOL.md.

minerva/<world>/to/<member>             coordinator → one member
minerva/<world>/all                     coordinator → every member
minerva/<world>/tick                    coordinator → members in step
minerva/<world>/evolve                  coordinator → hosts of agents
minerva/<world>/from/<member>           member → coordinator
minerva/<world>/view/<event type>       coordinator → observers
minerva/<world>/topic/<topic>/<member>  sensor readings, member → members
minerva/<world>/asset/<member>          queries of members for files that another one has
minerva/<world>/alive/<member>          liveliness tokens
minerva/<world>/claim/<member>/<number> liveliness tokens of processes that are about to take a name
minerva/<world>/epoch/<number>          liveliness tokens of coordinators
minerva/<world>/record                  coordinator → watchers, one message per frame
minerva/<world>/control                 queries by commands on the coordinator's machine
minerva/<world>/control/<name>          queries by an operator with a certificate of this name
minerva/<world>/ask/<name>              queries by others with a certificate: read only
"""

from __future__ import annotations

import re
from functools import lru_cache

from minerva_bus.errors import MisuseError
from minerva_bus.values import fast_dataclass

# Without the characters that have a meaning in Zenoh's key expressions (/ * $ ? #), so that no name
# matches other keys. No name begins with ~, which marks internal sources and parts.
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.~-]*")
MAX_NAME = 64
"""Characters of the longest name."""

ROOT = "minerva"
COORDINATOR = "coordinator"
ANY_WORLD = "*"


def is_name(text: str) -> bool:
    """Whether this can name a world, a member or a topic."""
    # The cache must not keep texts of any length.
    return len(text) <= MAX_NAME and _is_name(text)


@lru_cache(4096)  # The name in the key of each message is checked, and the names recur.
def _is_name(text: str) -> bool:
    return _NAME.fullmatch(text) is not None


def checked_name(name: str, what: str) -> str:
    """The name, if it is valid as part of a key. Raises MisuseError."""
    if not is_name(name):
        raise MisuseError(
            f"{name[: 2 * MAX_NAME]!r} cannot name {what}: use up to {MAX_NAME} letters, digits and"
            " _ . ~ -, beginning with a letter, digit or _"
        )
    return name


@fast_dataclass
class Keys:
    """The keys of one world."""

    world: str

    def __post_init__(self) -> None:
        checked_name(self.world, "a world")

    @property
    def base(self) -> str:
        """The common prefix of all keys of the world."""
        return f"{ROOT}/{self.world}"

    def kind(self, key: str) -> str:
        """The part of a key after the world, such as `from`; empty for keys of other worlds."""
        root, world, kind, *_ = [*key.split("/", 3), "", ""]
        return kind if (root, world) == (ROOT, self.world) else ""

    @property
    def all(self) -> str:
        """From the coordinator to every member."""
        return f"{self.base}/all"

    @property
    def tick(self) -> str:
        """From the coordinator to the members that receive the tick of every frame."""
        return f"{self.base}/tick"

    @property
    def evolve(self) -> str:
        """From the coordinator to the hosts of agents."""
        return f"{self.base}/evolve"

    @property
    def record(self) -> str:
        """The record of each frame."""
        return f"{self.base}/record"

    @property
    def control(self) -> str:
        """Queries by commands on this machine."""
        return control_key(self.world)

    def to(self, member: str) -> str:
        """From the coordinator to one member."""
        return f"{self.base}/to/{checked_name(member, 'a member')}"

    def sent_by(self, member: str) -> str:
        """From a member (`*`: from any) to the coordinator."""
        return f"{self.base}/from/{member}"

    def alive(self, member: str) -> str:
        """The liveliness token of a member (`*`: of any)."""
        return f"{self.base}/alive/{member}"

    def claim(self, member: str, number: str = "*") -> str:
        """The liveliness token of a process (`*`: of any) that is about to take a name."""
        return f"{self.base}/claim/{member}/{number}"

    def epoch(self, number: int | str) -> str:
        """The liveliness token of the coordinator of an epoch (`*`: of any)."""
        return f"{self.base}/epoch/{number}"

    def view(self, event_type: str) -> str:
        """Views for one visual event type (`*`: for any)."""
        return f"{self.base}/view/{event_type}"

    def topic(self, topic: str, member: str = "*") -> str:
        """Readings of one topic from one member, or from any."""
        return f"{self.base}/topic/{checked_name(topic, 'a topic')}/{member}"


def control_key(world: str, who: str = "") -> str:
    """Key of queries; `who` is the name of the asker's certificate, and `world` may be `*`."""
    return f"{ROOT}/{world}/control/{who}" if who else f"{ROOT}/{world}/control"


def asking_key(world: str, who: str) -> str:
    """Key of queries by holders of certificates that do not allow changes."""
    return f"{ROOT}/{world}/ask/{who}"


def who_asks(key: str, world: str) -> tuple[str, bool, str]:
    """Split a query's key: the asker, whether changes are allowed, and the reply's key.

    The asker is empty for a command on this machine.
    """
    rest = key.split("/", 2)[-1]
    kind, _, who = rest.partition("/")
    # A query on a pattern reaches this world, too; it is answered like a question without a name.
    if kind not in ("control", "ask"):
        return "", False, control_key(world)
    return who, kind == "control", f"{ROOT}/{world}/{kind}/{who}".rstrip("/")


def last_part(key: str) -> str:
    """The last chunk of a key: the sender, or the event type."""
    return key.rsplit("/", 1)[-1]
