"""What the machines of one world must have in common so that its regions have one string."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from hashlib import blake2b
from typing import Any, Final

from minerva_bus.frame.member import Refusal
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.log.journal import key_of
from minerva_bus.regions.partition import ByFunction

TERMS: Final = "terms"
"""Key in the saved data of a region's `welcome`."""

CONTINUES: Final = "string"
"""The term that is empty for a run that continues."""

ADOPTED: Final = ("seed", "frames", "until")
"""Terms that a region adopts from the coordinator, which may have them from its command line."""


def terms_of(file: WorldFile, ahead: int) -> dict[str, Any]:
    """The properties of a world file and its settings on which the frames of regions depend.

    Regions run `ahead` by so many frames.
    """
    world, partition = file.world, file.partition
    by = partition.function if isinstance(partition, ByFunction) else None
    count = 0 if partition is None else partition.count
    regions = repr(partition) if by is None else f"{count} by {by.__module__}:{by.__qualname__}"
    options = ", ".join(f"{name} = {value}" for name, value in sorted(file.options.items()))
    return {
        "seed": world.seed,
        "frames": world.frames,
        "until": world.until,
        "regions": regions,
        "lag": repr(world.lag),
        "frames ahead": ahead,
        "options": options,
        # Regions of a run that continues get their strings from the coordinator.
        CONTINUES: "" if world.past.frame else world.scene.digest.hex(),
        "vocabulary and rules": key_of(world).hex(),
        "norms": blake2b(repr(world.norms).encode(), digest_size=16).hexdigest(),
    }


def agreed(file: WorldFile, region: str, ahead: int, saved: Mapping[str, Any]) -> WorldFile:
    """The world file of a region with the settings in the data of its `welcome`.

    Raises Refusal if its terms differ from those of the world otherwise.
    """
    of_world = saved.get(TERMS, {})
    settings = {name: of_world.get(name, getattr(file.world, name)) for name in ADOPTED}
    if any(getattr(file.world, name) != value for name, value in settings.items()):
        file = replace(file, world=replace(file.world, **settings))
    for name, own in terms_of(file, ahead).items():
        continues = name == CONTINUES and of_world.get(name) == ""
        if of_world.get(name) != own and not continues:
            raise Refusal(
                f"{region} would not have the string of this world: {name}:"
                f" {of_world.get(name)!r:.80} in the world, {own!r:.80} here"
            )
    return file
