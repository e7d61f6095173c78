"""What a record says of its world, once, before its first frame."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

from minerva_bus import __version__
from minerva_bus.errors import MinervaError, ProtocolError
from minerva_bus.frame.description import World
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.log.errors import RecordError
from minerva_bus.log.norms import plain_norm, read_norms
from minerva_bus.wire.alphabet import plain_vocabulary, read_vocabulary
from minerva_bus.wire.limits import ON_DISK
from minerva_bus.wire.plain import as_int, as_list, as_map, as_number, as_text, pack, unpack
from minerva_bus.wire.values import Reader, plain_scene
from minerva_bus.world.evolution import Policy
from minerva_bus.world.order import Order

FORMAT: Final = 1
"""The version of the record's own messages; a reader reads this one and no other."""

LIMITS: Final = ON_DISK

_LEAST: Final = -(1 << 63)


def versions() -> dict[str, str]:
    """What the digests of a run depend on beside its world: the platform and its libraries."""
    found = {
        "minerva-bus": __version__,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
    }
    for package in ("eclipse-zenoh", "msgpack", "numpy", "pymunk", "mcap"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


@dataclass(frozen=True, slots=True)
class Description:
    """A world, the text of its file, its options, and what it ran on.

    `rate` is in frames per second, 0: as fast as it goes. `began` is in nanoseconds since 1970.
    `path` is where the world file lay.
    """

    world: World
    file: str = ""
    rate: float = 0.0
    options: Mapping[str, str] = field(default_factory=dict[str, str])
    versions: Mapping[str, str] = field(default_factory=versions)
    began: int = 0
    path: str = ""


def encode_description(told: Description, *, string: bool = True) -> bytes:
    """`["world", format, {...}]` as msgpack; with nil in the place of the `string`, if wanted."""
    world = told.world
    plain = {
        "name": world.name,
        "vocabulary": plain_vocabulary(world.vocabulary),
        "string": plain_scene(world.scene) if string else None,
        "seed": world.seed,
        "dt": world.dt,
        "order": list(world.order.types),
        "policy": world.policy.value,
        "frames": world.frames,
        "until": world.until,
        "give_up": world.give_up,
        "expected": sorted(world.expected),
        "speaks_for": {name: list(some) for name, some in world.speaks_for.items()},
        "norms": [plain_norm(norm) for norm in world.norms],
        "file": told.file,
        "rate": told.rate,
        "options": dict(told.options),
        "versions": dict(told.versions),
        "began": told.began,
        "path": told.path,
    }
    return pack(["world", FORMAT, plain])


def decode_description(data: bytes) -> tuple[Description, bool]:
    """A description, and whether it has the initial string. Raises RecordError."""
    try:
        items = as_list(unpack(data, LIMITS), "a description")
        if len(items) != 3 or items[0] != "world":
            raise ProtocolError('a description is ["world", format, {...}]')
        if items[1] != FORMAT:
            raise RecordError(
                f"its format is {items[1]!r}, this version of Minerva Bus reads {FORMAT}:"
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


def _description(plain: Mapping[str, Any]) -> Description:
    vocabulary = read_vocabulary(plain["vocabulary"])
    reader = Reader(vocabulary, LIMITS)
    world = World(
        name=as_text(plain["name"], "the name"),
        scene=EMPTY if plain["string"] is None else reader.scene(plain["string"]),
        vocabulary=vocabulary,
        seed=as_int(plain["seed"], "the seed", _LEAST),
        dt=as_number(plain["dt"], "dt"),
        order=Order(_texts(plain["order"])),
        policy=Policy(as_text(plain["policy"], "the policy")),
        frames=as_int(plain["frames"], "frames"),
        until=as_text(plain["until"], "until"),
        give_up=as_text(plain.get("give_up", ""), "give_up"),
        expected=frozenset(_texts(plain["expected"])),
        norms=read_norms(plain.get("norms", []), reader),
        speaks_for={
            name: _texts(some)
            for name, some in as_map(plain.get("speaks_for", {}), "speaks_for").items()
        },
    )
    return Description(
        world,
        as_text(plain["file"], "the world file"),
        as_number(plain["rate"], "the rate"),
        _pairs(plain["options"], "an option"),
        _pairs(plain["versions"], "a version"),
        as_int(plain["began"], "the beginning"),
        as_text(plain.get("path", ""), "the path"),
    )


def _texts(plain: Any) -> tuple[str, ...]:
    return tuple([as_text(one, "a name") for one in as_list(plain, "names")])


def _pairs(plain: Any, what: str) -> dict[str, str]:
    return {name: as_text(value, what) for name, value in as_map(plain, what).items()}
