"""Quality of service of topics, in the words of ROS 2 and as nodes announce it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.errors import MisuseError, nearest

MAX_DEPTH: Final = 1000
KEEP_ALL: Final = 1 << 31
"""A depth without a limit."""

_UNWRITTEN_DEPTH: Final = 42
"""The default of rmw_zenoh, which tokens do not contain."""

_WORDS: Final[Mapping[str, Mapping[str, Any]]] = {
    "default": {"reliable": True, "lasting": False, "depth": 10},
    "sensor_data": {"reliable": False, "lasting": False, "depth": 5},
    "reliable": {"reliable": True},
    "best_effort": {"reliable": False},
    "transient_local": {"lasting": True},
    "volatile": {"lasting": False},
    "keep_all": {"depth": KEEP_ALL},
}
"""Profiles and policies of ROS 2."""


@dataclass(frozen=True, slots=True)
class Qos:
    """What a publisher offers or a subscription asks for.

    `lasting` is transient local: also the messages from before. `depth` is how many messages are
    kept, or KEEP_ALL; 0 leaves that to this program.
    """

    reliable: bool = True
    lasting: bool = False
    depth: int = 0

    def __str__(self) -> str:
        """Its words that differ from ROS 2's default."""
        words = {
            "best_effort": not self.reliable, "transient_local": self.lasting,
            "keep_all": self.depth == KEEP_ALL,
        }  # fmt: skip
        return " ".join(word for word, differs in words.items() if differs)

    @property
    def token(self) -> str:
        """Its part of a token of rmw_zenoh, which contains only what differs from the default."""
        depth = self.depth or (1 if self.lasting else 10)
        kept = "" if depth in (_UNWRITTEN_DEPTH, KEEP_ALL) else depth
        history = f"{2 if depth == KEEP_ALL else ''},{kept}"
        return f"{'' if self.reliable else 2}:{1 if self.lasting else ''}:{history}:,:,:,,"


DEFAULT: Final = Qos()
LASTING: Final = Qos(lasting=True)
HEARING: Final = Qos(reliable=False)
"""What a publisher of any quality of service counts as a subscription.

Drivers of cameras measure only while somebody subscribes. It makes no difference to delivery.
"""


def announced_qos(text: str, layout: str) -> Qos:
    """The quality of service in a token; rmw_zenoh and DDS number its parts differently."""
    dds = layout == "dds"
    reliability, durability, history = [*text.split(":"), "", "", "", ""][1 if dds else 0 :][:3]
    keeps_all = history.partition(",")[0] == ("1" if dds else "2")
    reliable = reliability != ("0" if dds else "2")
    return Qos(reliable, durability == "1", KEEP_ALL if keeps_all else 0)


def asked_qos(where: str, text: Any, usual: Qos) -> Qos:
    """The quality of service in words such as "sensor_data" or "reliable transient_local 10".

    The first may be a profile, of which others replace parts. What no word says is as `usual`, and
    all of it for None. Raises MisuseError.
    """
    if text is None:
        return usual
    words = text.split() if isinstance(text, str) else []
    said, parts = set[str](), dict[str, Any]()
    for word in words or [""]:
        says = _WORDS.get(word) or _depth(word)
        if not says or says.keys() & (said if len(says) == 1 else parts.keys()):
            near = _WANTED if word in _WORDS else nearest(word, list(_WORDS), _WANTED)
            raise MisuseError(f"ros2: {where} is {text!r:.60}; {near.removeprefix('; ')}")
        parts |= says
        if len(says) == 1:
            said |= says.keys()
    # Who wants messages from before wants none of them to be lost.
    reliable = usual.reliable or parts.get("lasting", False)
    return Qos(**{"reliable": reliable, "lasting": usual.lasting, **parts})


def _depth(word: str) -> Mapping[str, Any]:
    is_number = word.isascii() and word.isdecimal() and 1 <= int(word[:9]) <= MAX_DEPTH
    return {"depth": int(word)} if is_number else {}


_WANTED: Final = (
    "expected a profile (default, sensor_data) or none, then reliable or best_effort, volatile or"
    f" transient_local, and keep_all or a depth from 1 to {MAX_DEPTH}"
)
