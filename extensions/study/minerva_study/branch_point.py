"""Branches of a recorded run: worlds that continue from one of its frames, each in another way.

The record is read once, up to that frame. Seed, options and settings of a branch may differ; its
vocabulary is that of the record. A branch in which nothing differs has the strings of the record.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from minerva_analysis.replays import world_file_of
from minerva_bus.errors import MisuseError
from minerva_bus.launch.assignment import assigned
from minerva_bus.launch.past import (
    Past,
    WorldSource,
    check_unfinished,
    completed,
    continued,
)
from minerva_bus.launch.toml_tables import of_nodes
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.log.entries import Keyframe
from minerva_bus.settings.world_settings import AS_WRITTEN, Overrides

if TYPE_CHECKING:
    from minerva_bus.log.entries import RecordHeader


@dataclass(frozen=True, slots=True)
class BranchPoint:
    """A frame of a record; calling it reads the world that continues there with some settings.

    Attributes:
        path: of the record.
        world: the source of the world with the code.
        description: of the recorded world.
        state: the state with which the frame begins.
        end: the number of recorded frames, where branches end by default.

    """

    path: Path
    world: WorldSource
    description: RecordHeader
    state: Keyframe
    end: int
    _files: dict[str, WorldFile] = field(
        default_factory=dict[str, "WorldFile"], compare=False, repr=False
    )

    def __call__(self, overrides: Overrides) -> WorldFile:
        """The world of a branch. Raises MinervaError if it cannot continue from here."""
        # A frame may have nodes that the world's first string does not have.
        nodes = tuple(filter(of_nodes, overrides.settings))
        file = self._read(_without(nodes, overrides))
        scene = assigned(self.state.scene, file.world.vocabulary, nodes)
        seed = completed(overrides, self.description).values.get("seed", file.world.seed)
        world = continued(file.world, self.state, self.description.world)
        world = replace(world, seed=seed, scene=scene)
        check_unfinished(world, self.path)
        return replace(file, world=world)

    def with_world(self, world: WorldSource) -> BranchPoint:
        """The same frame, continued by the code of another source."""
        return replace(self, world=world, _files={})

    def _read(self, overrides: Overrides) -> WorldFile:
        """The world file with these settings; reading it takes longer than many a branch."""
        values = {name: value for name, value in overrides.values.items() if name != "seed"}
        # Nothing in a world file depends on the seed but the seed itself.
        key = repr((sorted(overrides.options.items()), overrides.settings, sorted(values.items())))
        if key not in self._files:
            given = overrides.over(Overrides(frames=self.end))
            self._files[key] = world_file_of(self.path, self.world, self.description, given)
        return self._files[key]


def _without(nodes: tuple[str, ...], given: Overrides) -> Overrides:
    """The other settings than those of nodes."""
    others = tuple([setting for setting in given.settings if setting not in nodes])
    return Overrides(
        given.options, others, given.views, given.collect, given.only_code, **given.values
    )


def read_branch_point(path: Path, frame: int, world: WorldSource) -> BranchPoint:
    """Frame `frame` of a record, from which runs can branch; `world` has the agents' code.

    Raises:
        RecordError: the record cannot be read, or has no checkpoints.
        MisuseError: there is no such frame in it.
        MinervaError: it is the record of another world.

    """
    from minerva_bus.log.record import Record

    with Record(path) as record:
        end, _ = record.last()
        if not 0 <= frame <= end:
            raise MisuseError(f"{path}: runs can branch at frames 0 to {end}, not {frame}")
        file = world_file_of(path, world, record.description, AS_WRITTEN)
        return BranchPoint(path, world, record.description, Past(record, file).state(frame), end)


def recorded_digest(path: Path, frame: int) -> str:
    """The digest of the string before a frame, in hexadecimal; "" if the record does not have it.

    Raises RecordError.
    """
    from minerva_bus.log.record import Cursor, Record

    with Record(path) as record:
        cursor = Cursor(record)
        cursor.skip_to(frame)
        return cursor.scene.digest.hex() if cursor.number == frame else ""
