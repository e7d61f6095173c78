"""Description of a record's world, written before its first frame."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

from minerva_bus import __version__
from minerva_bus.errors import MinervaError, ProtocolError, RecordError
from minerva_bus.frame.description import WorldSpec
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.log.entries import FORMAT
from minerva_bus.wire.message_limits import ON_DISK
from minerva_bus.wire.plain import (
    as_int,
    as_list,
    as_map,
    as_number,
    as_text,
    as_texts,
    pack,
    unpack,
)
from minerva_bus.wire.strings_codec import Reader, plain_event, plain_scene
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary
from minerva_bus.world.evolution import Policy
from minerva_bus.world.norms import Norm, Then
from minerva_bus.world.priority import Priority

_LEAST: Final = -(1 << 63)


def versions() -> dict[str, str]:
    """Versions that the digests of a run depend on: platform and libraries."""
    installed = {
        "minerva-bus": __version__,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
    }
    for package in ("eclipse-zenoh", "msgpack", "numpy", "pymunk", "mcap"):
        if (number := _installed_version(package)) is not None:
            installed[package] = number
    return installed


@cache  # Each call reads and parses a file, and several parts of a process describe its world.
def _installed_version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@dataclass(frozen=True, slots=True)
class RecordHeader:
    """A world, the text and path of its file, its options, and the versions it ran on.

    `rate`: frames per second; 0 means as fast as possible. `began`: nanoseconds since 1970.
    `frame`: the frame that begins with the world's string; not 0 in a record that lacks the frames
    before it.
    """

    world: WorldSpec
    file: str = ""
    rate: float = 0.0
    options: Mapping[str, str] = field(default_factory=dict[str, str])
    versions: Mapping[str, str] = field(default_factory=versions)
    began: int = 0
    path: str = ""
    frame: int = 0


def encode_header(description: RecordHeader, *, string: bool = True) -> bytes:
    """`["world", format, {...}]` as msgpack; without `string`, nil instead of the string."""
    world = description.world
    plain = {
        "name": world.name,
        "vocabulary": plain_vocabulary(world.vocabulary),
        # The second copy of the description omits it: the first keyframe contains it, too.
        "string": plain_scene(world.scene) if string else None,
        "seed": world.seed,
        "dt": world.dt,
        "order": list(world.order.types),
        "policy": world.policy.value,
        "frames": world.frames,
        "until": world.until,
        "give_up": world.give_up,
        "expected": sorted(world.expected),
        "speaks_for": {name: list(kinds) for name, kinds in world.speaks_for.items()},
        "norms": [plain_norm(norm) for norm in world.norms],
        "file": description.file,
        "rate": description.rate,
        "options": dict(description.options),
        "versions": dict(description.versions),
        "began": description.began,
        "path": description.path,
        "frame": description.frame,
    }
    return pack(["world", FORMAT, plain])


def decode_header(data: bytes) -> tuple[RecordHeader, bool]:
    """A description, and whether it includes the initial string. Raises RecordError."""
    try:
        items = as_list(unpack(data, ON_DISK), "a description")
        if len(items) != 3 or items[0] != "world":
            raise ProtocolError('a description is ["world", format, {...}]')
        if items[1] != FORMAT:
            raise RecordError(
                f"its format is {items[1]!r}; this version of Minerva Bus reads {FORMAT}:"
                " read it with the version that wrote it"
            )
        plain = as_map(items[2], "a description")
        return _description(plain), plain["string"] is not None
    except KeyError as missing:
        raise RecordError(f"its description lacks {missing}") from None
    except RecordError:
        raise
    except (MinervaError, ValueError, RecursionError) as error:
        raise RecordError(f"its description is wrong: {error}") from None


def _description(plain: Mapping[str, Any]) -> RecordHeader:
    vocabulary = read_vocabulary(plain["vocabulary"])
    reader = Reader(vocabulary, ON_DISK)
    world = WorldSpec(
        name=as_text(plain["name"], "the name"),
        scene=EMPTY if plain["string"] is None else reader.scene(plain["string"]),
        vocabulary=vocabulary,
        seed=as_int(plain["seed"], "the seed", _LEAST),
        dt=as_number(plain["dt"], "dt"),
        order=Priority(as_texts(plain["order"], "order")),
        policy=Policy(as_text(plain["policy"], "the policy")),
        frames=as_int(plain["frames"], "frames"),
        until=as_text(plain["until"], "until"),
        give_up=as_text(plain["give_up"], "give_up"),
        expected=frozenset(as_texts(plain["expected"], "expected")),
        norms=read_norms(plain["norms"], reader),
        speaks_for={
            name: as_texts(kinds, "speaks_for")
            for name, kinds in as_map(plain["speaks_for"], "speaks_for").items()
        },
    )
    return RecordHeader(
        world,
        as_text(plain["file"], "the world file"),
        as_number(plain["rate"], "the rate"),
        _pairs(plain["options"], "an option"),
        _pairs(plain["versions"], "a version"),
        as_int(plain["began"], "the beginning"),
        as_text(plain["path"], "the path"),
        frame=as_int(plain["frame"], "the frame"),
    )


def _pairs(plain: Any, what: str) -> dict[str, str]:
    return {name: as_text(value, what) for name, value in as_map(plain, what).items()}


# --- norms ---


def plain_norm(norm: Norm) -> dict[str, Any]:
    """A norm as plain data."""
    return {
        "name": norm.name,
        "applies": list(norm.applies),
        "on": list(norm.on),
        "when": norm.when,
        "where": norm.where,
        "most": norm.most,
        "per": norm.per,
        "then": norm.then.value,
        "sanction": None if norm.sanction is None else plain_event(norm.sanction),
    }


def read_norms(plain: Any, reader: Reader) -> tuple[Norm, ...]:
    """Norms from plain data. Raises ProtocolError, VocabularyError and ValueError."""
    return tuple([_norm(as_map(norm, "a norm"), reader) for norm in as_list(plain, "norms")])


def _norm(plain: dict[str, Any], reader: Reader) -> Norm:
    sanction = None if plain["sanction"] is None else reader.event(plain["sanction"])
    if sanction is not None and not isinstance(sanction, Event):
        raise ProtocolError("a sanction is one event")
    return Norm(
        as_text(plain["name"], "a norm's name"),
        as_texts(plain["applies"], "applies"),
        as_texts(plain["on"], "on"),
        as_text(plain["when"], "when"),
        as_text(plain["where"], "where"),
        as_int(plain["most"], "most"),
        as_int(plain["per"], "per", 1),
        Then(as_text(plain["then"], "then")),
        sanction,
    )
