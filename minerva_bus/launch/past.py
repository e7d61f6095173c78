"""The past of a run with the code of its world, and worlds that continue it: `run --resume FILE`.

A record has strings, events and checkpoints, but no code. The code is that of the world file, which
must have the same vocabulary and rules. Options, seed, name, rate and end are those of the record
unless the command line sets them. θ computes the last views again, because coupled devices act on
them in the next frame; views depend only on the string and the events (equation 5).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from minerva_bus.errors import MinervaError, MisuseError, RecordError, WorldFileError
from minerva_bus.files import path_of_text
from minerva_bus.frame.algorithm import GIVEN_UP, WorldGoal
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.messages import ViewShown
from minerva_bus.frame.stimuli import HALTED, Checkpoint
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.process_specs import forgotten
from minerva_bus.launch.toml_tables import Table, TomlError, of_nodes, option_text, read_toml
from minerva_bus.launch.world_files import WorldFile, read_world_file
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.vocabulary_codec import plain_vocabulary
from minerva_bus.wording import named_some
from minerva_bus.world.agent import Agent, Kinds, kinds_of
from minerva_bus.world.norms import SOURCE
from minerva_bus.world.visualization import visualize

if TYPE_CHECKING:
    from minerva_bus.log.entries import Keyframe, RecordHeader
    from minerva_bus.log.record import Record

WorldSource: TypeAlias = str | Callable[[Overrides], WorldFile]
"""A world with the code of a record: its file or installed name ("": as recorded), or a reader."""

MAX_NAMED: Final = 5
"""Names of each difference in a message."""


@fast_dataclass
class Resumed(WorldFile):
    """A world file whose world continues after the end of the record `origin`."""

    origin: Path = field(default_factory=Path)


def read_resumed(path: Path, world: WorldSource, overrides: Overrides) -> Resumed:
    """The world of a record in its last known state; `world` names its file if it has moved.

    Raises RecordError, WorldFileError and SceneError, and MinervaError if the file is of another
    world or the run is over.
    """
    from minerva_bus.log.record import Record

    for setting in filter(of_nodes, overrides.settings):
        raise MisuseError(
            f"--set {setting}: a resumed run continues with its own string; minerva branch sets"
            " values at a frame"
        )
    with Record(path) as record:
        description = record.description
        given = completed(overrides, description)
        wanted = f"minerva run WORLD --resume {path}"
        file = read_source(world, description, wanted, given)
        check_same(file.world, description.world, path)
        damage = tuple(damage_of(record))
        resumed = continued(file.world, Past(record, file).state(), description.world)
        check_unfinished(resumed, path)
    # Without --record the run is recorded in the same file.
    kept = replace(file.record, path=file.record.path or str(path))
    notes = (f"continuing from frame {resumed.past.frame} of {path}", *damage)
    notes += (*_unused(resumed.past, file), *forgotten(file.processes), *file.notes)
    # `replace` cannot make an object of another class.
    settings: dict[str, Any] = {f.name: getattr(file, f.name) for f in fields(WorldFile)}
    settings.update(world=resumed, notes=notes, record=kept, origin=path)
    return Resumed(**settings)


def continued(world: WorldSpec, state: Keyframe, recorded: WorldSpec) -> WorldSpec:
    """A world that continues from a state of a recorded one, maybe toward another goal `until`."""
    world = state.begins(world)
    if world.until == recorded.until:
        return world
    # Agents that have sent the old `until`, or have given up, have not sent the new one.
    saved = {name: data for name, data in world.past.saved.items() if name != GIVEN_UP}
    nobody: frozenset[str] = frozenset()
    past = replace(world.past, saved=saved, reached=nobody, reaching=nobody)
    return replace(world, past=past)


def damage_of(record: Record) -> Iterator[str]:
    """Messages about the damage of a record and the frames lost, which the caller reports."""
    record.reported = True
    losses = record.losses()
    if message := losses.message(record.path):
        yield message
    if losses.cut:
        yield f"{record.path} was cut off: what its last {losses.cut:,} bytes had is lost"


def _unused(checkpoint: Checkpoint, file: WorldFile) -> Iterator[str]:
    """Messages about saved data of members that are not in the world file."""
    own = {SOURCE, GIVEN_UP, HALTED, *(process.name for process in file.processes)}
    for name in sorted(checkpoint.saved.keys() - own):
        yield f"what {name} has saved waits for a member of this name: no process has it"


# --- the world file of a record ---


def find_file(world: str, description: RecordHeader, wanted: str) -> Path:
    """The world file that the command line names, or that of the record's run.

    `wanted` is the command that names a file that has moved. Raises WorldFileError.
    """
    if world:
        return find_world(world)
    path = path_of_text(description.path)
    if description.path and path.is_file():
        return path
    where = f" {description.path}" if description.path else ""
    raise WorldFileError(f"the record's world file{where} is not here: name it, {wanted}")


def read_source(
    world: WorldSource, description: RecordHeader, wanted: str, given: Overrides
) -> WorldFile:
    """The world that has the code of a record; see `find_file`. Raises WorldFileError."""
    if not isinstance(world, str):
        return world(given)
    return read_world_file(find_file(world, description, wanted), given)


def completed(overrides: Overrides, description: RecordHeader) -> Overrides:
    """The settings of the command line, over those of the record.

    A requested view chooses its own rate.
    """
    world = description.world
    recorded = Overrides(
        _options(description),
        name=world.name,
        seed=world.seed,
        frames=world.frames,
        until=world.until,
        rate=None if overrides.views else description.rate,
    )
    return overrides.over(recorded)


def _options(description: RecordHeader) -> dict[str, str]:
    """The declared options of a run whose values differ from those in its world file."""
    try:
        table = Table(read_toml(description.file), "", description.file, description.path).table(
            "options"
        )
    except (TomlError, MinervaError):
        return {}
    declared = {name: option_text(value) for name, value in table.rest().items()}
    return {
        name: description.options[name]
        for name, own in declared.items()
        if name in description.options and description.options[name] != own
    }


def check_same(world: WorldSpec, recorded: WorldSpec, path: Path) -> None:
    """Raises MinervaError if the frames of two worlds would differ."""
    for what in differing(world, recorded):
        raise MinervaError(f"{path}: it is the record of another world: {what}")
    changed = {source for _, source in world.shares.items() ^ recorded.shares.items()}
    if divided := changed & {*world.shares.values()} & {*recorded.shares.values()}:
        raise MinervaError(f"{path}: {min(divided)} needs as many processes as it had")


def differing(world: WorldSpec, recorded: WorldSpec) -> Iterator[str]:
    """Differences between two worlds, beside their strings, that change their frames."""
    for what in ("seed", "dt", "policy"):
        wanted, before = getattr(world, what), getattr(recorded, what)
        if wanted != before:
            wanted, before = getattr(wanted, "value", wanted), getattr(before, "value", before)
            yield f"{what} {before} is recorded, {wanted} is wanted"
    what = differing_vocabulary(world.vocabulary, recorded.vocabulary)
    if what:
        yield what
    if world.norms != recorded.norms:
        yield "its norms are not those of the world file"
    if world.order != recorded.order:
        yield "its order of events is not the one of the world file"


def differing_vocabulary(wanted: Vocabulary, recorded: Vocabulary) -> str:
    """A message if two vocabularies differ in what frames use, or an empty string.

    Pictures, and the fates of orders, are not part of frames: they may have changed.
    """
    now, before = _used(wanted), _used(recorded)
    named = {
        "it lacks": now.keys() - before.keys(),
        "the world file lacks": before.keys() - now.keys(),
        "these are declared otherwise:": {
            name for name in now.keys() & before.keys() if now[name] != before[name]
        },
    }
    shown = [
        f"{what} {named_some(sorted(names), MAX_NAMED)}" for what, names in named.items() if names
    ]
    if not shown:
        return ""
    return f"its vocabulary is not the one of the world file: {'; '.join(shown)}"


def _used(vocabulary: Vocabulary) -> dict[str, Any]:
    """The declarations of a vocabulary that frames use, by name."""
    plain = plain_vocabulary(vocabulary)
    sections = ("primitives", "transformations", "kinds", "events")
    return {declared[0]: declared[1:] for section in sections for declared in plain[section]}


def check_unfinished(world: WorldSpec, path: Path) -> None:
    """Raises MinervaError if the run is over."""
    composition = Composition(world.scene)
    finished = WorldGoal(world, composition, dict(world.past.saved)).finished
    if composition.empty:
        raise MinervaError(f"{path}: this run is over: its string is empty")
    if finished:
        raise MinervaError(f"{path}: this run is over: {finished}; --until '' continues")
    if world.frames and world.past.frame >= world.frames:
        raise MinervaError(
            f"{path}: this run is over after {world.past.frame} frames; --frames N continues to"
            " frame N, or 0 without end"
        )


# --- states ---


@fast_dataclass
class Past:
    """A record, and the world file with the code of its agents."""

    record: Record
    file: WorldFile

    def state(self, frame: int | None = None) -> Keyframe:
        """The state with which a frame begins, by default the last known one.

        It has the last views of coupled devices. Raises RecordError if the record lacks the
        checkpoint.
        """
        from minerva_bus.log.entries import Keyframe
        from minerva_bus.log.record import Cursor

        if frame is None:
            past, scene = self.record.end()
        else:
            cursor = Cursor(self.record, state=True)
            scene = cursor.seek(frame)
            past = cursor.checkpoint if frame else Checkpoint()
            if past is None:
                raise RecordError(
                    f"{self.record.path}: it has no checkpoint of frame {frame}; choose another"
                )
        return Keyframe(past.frame, scene, past, self._views(past))

    def _views(self, past: Checkpoint) -> list[ViewShown]:
        """The last views of coupled devices, as keyframes."""
        kinds, halted = kinds_in(self.file), past.saved.get(HALTED, {})
        views: list[ViewShown] = []
        recorded = self.record.last_events(_coupled(self.file), past.frame)
        for event_type, (frame, events) in sorted(recorded.items()):
            drawn = [event for event in events if event.type == event_type]
            try:
                string = self.record.string(frame)
            except RecordError:  # A damaged record: the device waits for the next view.
                continue
            # Only a view of the last frame has halted agents.
            still = tuple(halted["agents"]) if halted.get("frame") == frame else ()
            # In parts, because devices know by them whose each figure is.
            composition = Composition(string, columns=not self.file.world.policy.rules.makes_copies)
            parts = {
                name: visualize(Scene((fragment,)), drawn, kinds, frame)
                for name, fragment in composition.fragments.items()
            }
            shown = composition.skeleton
            views.append(ViewShown(event_type, frame, past.frame, parts, shown, halted=still))
        return views


def kinds_in(file: WorldFile) -> Kinds:
    """The agent classes of all processes of a world file."""
    classes: dict[type[Agent], None] = {}
    for process in file.processes:
        classes.update(dict.fromkeys(process.agents))
    return kinds_of(list(classes))


def _coupled(file: WorldFile) -> frozenset[str]:
    """Visual event types whose views can influence later frames."""
    if any(process.command for process in file.processes):  # Their views are unknown here.
        return frozenset(e.name for e in file.world.vocabulary.events.values() if e.visual)
    hellos = [process.make_member().hello() for process in file.processes]
    return frozenset(draws for hello in hellos if hello.coupled for draws in hello.draws)
