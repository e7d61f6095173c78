"""Branches of a recorded run: worlds that continue from one of its frames, each in another way.

The record is read once, up to that frame. Seed, options and settings of a branch may differ; its
vocabulary is that of the record. A branch in which nothing differs has the strings of the record.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from minerva_bus.errors import MisuseError
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.messages import ViewShown
from minerva_bus.grammar.assignment import assigned
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.past import (
    WorldSource,
    check_unfinished,
    completed,
    last_views,
    toward,
    world_file_of,
)
from minerva_bus.launch.typed_text import of_nodes
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.settings.overrides import AS_WRITTEN, Overrides

if TYPE_CHECKING:
    from minerva_bus.log.description import Description
    from minerva_bus.log.reader import Record


@dataclass(frozen=True, slots=True)
class BranchPoint:
    """A frame of a record; calling it reads the world that continues there with some settings.

    Attributes:
        path: of the record.
        world: the source of the world with the code.
        description: of the recorded world.
        scene: the string with which the frame begins.
        past: the rest of the state; its `frame` is the number of the frame.
        shown: the last views of coupled devices.
        end: the number of recorded frames, where branches end by default.

    """

    path: Path
    world: WorldSource
    description: Description
    scene: Scene
    past: Checkpoint
    shown: tuple[ViewShown, ...]
    end: int
    _files: dict[str, WorldFile] = field(
        default_factory=dict[str, "WorldFile"], compare=False, repr=False
    )

    def __call__(self, overrides: Overrides) -> WorldFile:
        """The world of a branch. Raises MinervaError if it cannot continue from here."""
        # A frame may have nodes that the world's first string does not have.
        nodes = tuple(filter(of_nodes, overrides.settings))
        file = self._read(_without(nodes, overrides))
        scene = assigned(self.scene, file.world.vocabulary, nodes)
        seed = completed(overrides, self.description).values.get("seed", file.world.seed)
        past = toward(self.past, file.world, self.description.world)
        world = replace(file.world, seed=seed, scene=scene, past=past, shown=self.shown)
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
    from minerva_bus.log.reader import Record

    with Record(path) as record:
        end, _ = record.last()
        if not 0 <= frame <= end:
            raise MisuseError(f"{path}: runs can branch at frames 0 to {end}, not {frame}")
        scene, past = _state(record, frame)
        file = world_file_of(path, world, record.description, AS_WRITTEN)
        shown = tuple(last_views(record, file, past))
        return BranchPoint(path, world, record.description, scene, past, shown, end)


def _state(record: Record, frame: int) -> tuple[Scene, Checkpoint]:
    """The string and the checkpoint with which a frame begins. Raises RecordError."""
    from minerva_bus.log.cursor import Cursor
    from minerva_bus.log.errors import RecordError

    cursor = Cursor(record, state=True)
    scene = cursor.seek(frame)
    past = cursor.checkpoint if frame else Checkpoint()
    if past is None:
        raise RecordError(f"{record.path}: it has no checkpoint of frame {frame}; choose another")
    return scene, past


def recorded_digest(path: Path, frame: int) -> str:
    """The digest of the string before a frame, in hexadecimal; "" if the record does not have it.

    Raises RecordError.
    """
    from minerva_bus.log.cursor import Cursor
    from minerva_bus.log.reader import Record

    with Record(path) as record:
        cursor = Cursor(record)
        cursor.skip_to(frame)
        return cursor.scene.digest.hex() if cursor.number == frame else ""
