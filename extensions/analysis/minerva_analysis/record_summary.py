"""A record for people: its summary and its frames (`minerva info`), and its intact parts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from minerva_analysis.frame_texts import FrameText, kinds_in, missing_frame
from minerva_analysis.indexes import all_losses
from minerva_bus.errors import MisuseError, RecordError
from minerva_bus.files import check_new, replacing
from minerva_bus.frame.stimuli import RecordedFrame
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.chunks import Losses
from minerva_bus.log.entries import Dropped
from minerva_bus.log.record import Cursor, Record
from minerva_bus.log.record_writer import RecordWriter
from minerva_bus.wording import counted
from minerva_bus.world.norms import SOURCE
from minerva_bus.world.operator import PersonOperation


@dataclass(frozen=True, slots=True)
class Info:
    """Numbers about a record.

    `seconds`: world time. `wall_seconds`: time by the clock. `missing`: frames that were not
    recorded. `topics`: readings by topic. `dropped`: messages on topics that were not recorded.
    `first_agents`, `last_agents`: agents by kind. `broken`: violations by norm. `checked`: there
    are frames, none is damaged, and all digests are right. `losses`: damage.
    """

    world: str
    seed: int
    size: int
    complete: bool
    frames: int
    missing: int
    seconds: float
    wall_seconds: float
    digest: str
    events: Mapping[str, int]
    first_agents: Mapping[str, int]
    last_agents: Mapping[str, int]
    broken: Mapping[str, int]
    log_lines: int
    operations: tuple[PersonOperation, ...]
    topics: Mapping[str, int]
    dropped: int
    timings: Mapping[str, float]
    options: Mapping[str, str]
    versions: Mapping[str, str]
    checked: bool
    losses: Losses

    def plain(self) -> dict[str, Any]:
        """The summary as a JSON object."""
        shown = {name: _plain(getattr(self, name)) for name in self.__slots__ if name != "losses"}
        shown["operations"] = [asdict(operation) for operation in self.operations]
        return shown | self.losses.plain()

    def lines(self) -> list[str]:
        """The summary as lines of text."""
        state = "complete" if self.complete else "cut off: its world did not end as it should"
        first, last = self.first_agents, self.last_agents
        kinds = {
            kind: f"{first.get(kind, 0):,} → {last.get(kind, 0):,}"
            for kind in sorted({*first, *last})
        }
        options = {name: value for name, value in self.options.items() if value}
        rows = {
            "": f"{self.size:,} bytes, {state}",
            "frames": f"{self.frames:,}" + (f", {self.missing:,} missing" if self.missing else ""),
            "time": f"{self.seconds:.2f} s of the world, {self.wall_seconds:.2f} s by the clock",
            "agents": _pairs(kinds),
            "events": _pairs({name: f"{count:,}" for name, count in self.events.items()}),
            "norms": _pairs({name: f"{count:,}" for name, count in self.broken.items()}),
            "topics": _pairs({name: f"{count:,}" for name, count in self.topics.items()})
            + (f" ({self.dropped:,} messages dropped)" if self.dropped else ""),
            "a frame": _pairs({name: f"{1000 * s:.2f} ms" for name, s in self.timings.items()}),
            "log": counted(self.log_lines, "line") if self.log_lines else "",
            "operated": self._operated(),
            "options": _pairs(options),
            "written by": _pairs(self.versions),
            "damaged": self.losses.damaged,
            "lost": self.losses.frames,
            "digest": self.digest + ("  (all digests are right)" if self.checked else ""),
        }
        shown = [f"  {name:10}  {text}" for name, text in rows.items() if name and text]
        if self.losses.damage:
            shown.append("  minerva recover writes all that is intact into a new record")
        return [f"{self.world}, seed {self.seed}: {rows['']}", *shown]

    def _operated(self) -> str:
        """What people did, with the number of times."""
        counts = Counter([replace(each, frame=0, value="") for each in self.operations])
        return ", ".join(
            [f"{each} ×{count}" if count > 1 else str(each) for each, count in counts.items()]
        )


def info_of(record: Record, check: bool = False) -> Info:
    """Summary of a record. Raises RecordError, with `check` also for a wrong digest."""
    world = record.description.world
    events: Counter[str] = Counter()
    count = 0
    last: RecordedFrame | None = None
    scene = world.scene
    for frame, scene in record.strings(check):  # noqa: B007
        count, last = count + 1, frame
        events.update(_counted(frame.events))
    events.update(_counted(record.closing_events()))
    topics, dropped = _sensed(record)
    losses = all_losses(record) if check else record.losses()
    reached = last.number + 1 if last is not None else 0
    return Info(
        world=world.name,
        seed=world.seed,
        size=record.size,
        complete=record.complete,
        frames=count,
        # Frames are numbered from 0, so dropped and lost ones leave gaps.
        missing=reached - count,
        seconds=reached * world.dt,
        wall_seconds=last.seconds if last is not None else 0.0,
        digest=(last.digest if last is not None else scene.digest).hex(),
        events=dict(sorted(events.items())),
        first_agents=kinds_in(world.scene),
        last_agents=kinds_in(scene),
        broken=_broken(record),
        log_lines=sum(1 for _ in record.log()),
        operations=tuple(record.operations()),
        topics=topics,
        dropped=dropped,
        timings=_means(record.timings()),
        options=record.description.options,
        versions=record.description.versions,
        checked=check and count > 0 and not losses.damage,
        losses=losses,
    )


def _broken(record: Record) -> dict[str, int]:
    """Number of violations of each norm."""
    if not record.description.world.norms:
        return {}
    try:
        saved = record.end()[0].saved
    except RecordError:  # it has no checkpoints
        return {}
    return dict(saved.get(SOURCE, {}).get("broken", {}))


def _counted(events: Iterable[AnyEvent]) -> Counter[str]:
    counts: Counter[str] = Counter()
    for event in events:
        counts[event.type] += len(event)
    return counts


def _sensed(record: Record) -> tuple[dict[str, int], int]:
    """Number of readings by topic, and of dropped messages."""
    counts: Counter[str] = Counter()
    dropped = 0
    for _, sensed in record.sensed():
        if isinstance(sensed, Dropped):
            dropped += sensed.count
        else:
            counts[sensed.topic] += len(sensed.readings)
    return dict(sorted(counts.items())), dropped


def _means(timings: Iterable[Mapping[str, float]]) -> dict[str, float]:
    sums: dict[str, float] = {}
    count = 0
    for timing in timings:
        count += 1
        for name, seconds in timing.items():
            sums[name] = sums.get(name, 0.0) + seconds
    return {name: total / count for name, total in sums.items() if name not in _NO_TIMING}


_NO_TIMING = frozenset(("frame", "seconds"))


def _pairs(values: Mapping[str, str]) -> str:
    return ", ".join([f"{name} {value}" for name, value in values.items()])


def _plain(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else value  # pyright: ignore


# --- one frame ---


def moment_of(record: Record, number: int | None) -> FrameText:
    """A frame of a record, or its end for None. Raises RecordError for a missing frame."""
    end, string = record.last()
    events: tuple[AnyEvent, ...] = ()
    is_end = number is None or number == end
    if number is None or number == end:
        number, events = end, record.closing_events()
    elif 0 <= number < end:
        cursor = Cursor(record)
        string = cursor.seek(number)
        frame = cursor.ahead
        # If it was not recorded, a later one may be ahead.
        events = frame.events if frame is not None and frame.number == number else ()
    else:
        raise RecordError(missing_frame(record.path, end, number))
    seconds = number * record.description.world.dt
    title = f"{seconds:.2f} s of the world"
    return FrameText(title, number, seconds, string, string.digest, events, is_end)


def written(string: Scene) -> str:
    """A string in the world's language, one outermost node per line; it can be parsed again."""
    return "\n· ".join([str(Scene((node,))) for node in string.nodes])


# --- the intact parts of a damaged record: `minerva recover` ---


@dataclass(frozen=True, slots=True)
class Recovered:
    """Result of a recovery: the new record, its number of frames, and the losses."""

    path: Path
    frames: int
    losses: Losses

    def plain(self) -> dict[str, Any]:
        """The result as a JSON object."""
        return {"record": str(self.path), "frames": self.frames} | self.losses.plain()

    def lines(self) -> list[str]:
        """The result as lines of text."""
        losses = self.losses
        shown = [f"{self.path}: {counted(self.frames, 'frame')}"]
        if losses.damage:
            count = sum(damage.end - damage.begin for damage in losses.damage)
            places = counted(len(losses.damage), "place")
            shown.append(f"damaged: {count:,} bytes in {places}, {losses.damaged}")
            shown.append(f"lost: {losses.frames}")
        elif losses.cut:
            shown.append(f"cut off: its last {losses.cut:,} bytes belong to no complete chunk")
        else:
            shown.append("nothing was damaged")
        return shown


def recovered_name(path: Path) -> Path:
    """Default path of a recovered record."""
    return path.with_name(f"{path.stem}.recovered{path.suffix}")


def recover(path: Path, into: Path) -> Recovered:
    """Copy the intact parts of a record to a new, complete record.

    Raises RecordError if no frame is intact, and MisuseError if the file exists or cannot be
    written.
    """
    with Record(path) as record:
        check_new(into, "record")
        losses = all_losses(record)
        if (losses.damage or not record.complete) and next(record.frames(), None) is None:
            raise RecordError(f"{path}: no frame in it is intact")
        try:
            # A recovery that fails leaves no half-written record.
            with replacing(into) as stream:
                writer = RecordWriter(stream, record.description, record)
                writer.finish()
        except OSError as error:
            raise MisuseError(f"{into}: cannot be written: {error.strerror}") from None
    return Recovered(into, writer.frames, losses)
