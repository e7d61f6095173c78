"""The first pass over records: whose lives are episodes, and which sensors they have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from minerva_analysis.frame_texts import kinds_in
from minerva_bus.collect.collector import agent_rows
from minerva_bus.collect.data_tables import texts
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.vocabulary import AgentKind, Vocabulary
from minerva_bus.log.record import Record
from minerva_bus.wire.vocabulary_codec import plain_vocabulary
from minerva_bus.world.readings import Image, Reading
from minerva_exporters.actions import Actions
from minerva_exporters.datasets import ExportChoice
from minerva_exporters.sources import FrameContents, RecordFrames
from minerva_exporters.vectors import RowVectors, is_numeric, reading_names

MAX_EPISODES: Final = 500
"""Agents of one record whose lives are episodes; each has an open file."""


@dataclass(slots=True)
class Episode:
    """The life of an agent in a record; `length` is its number of rows."""

    number: int
    record: Path
    agent: str
    begin: int
    length: int = 0


@dataclass(slots=True)
class Survey:
    """The episodes of records, and the layout of their data.

    `task` is the name of the world. `vectors` are the names of a sensor's numbers by topic,
    `images` the sizes of images: height, width and channels.
    """

    kind: AgentKind
    vocabulary: Vocabulary
    task: str
    dt: float
    actions: Actions
    chosen: frozenset[str]
    episodes: list[Episode] = field(default_factory=list[Episode])
    vectors: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    images: dict[str, tuple[int, int, int]] = field(default_factory=dict[str, tuple[int, int, int]])

    @property
    def state(self) -> RowVectors:
        """The attributes that are observed."""
        return RowVectors(tuple(filter(is_numeric, self.kind.fields.all)))

    def agents(self, frame: FrameContents) -> list[str]:
        """The ids of the agents of a frame whose lives are episodes."""
        rows = agent_rows(frame.scene, self.kind.name, self.kind.fields)
        ids: list[str] = texts(rows.ids()).tolist()
        return [each for each in ids if each in self.chosen] if self.chosen else ids

    def episodes_of(self, record: Path) -> Mapping[str, Episode]:
        """The episodes of a record, by agent."""
        return {each.agent: each for each in self.episodes if each.record == record}


def survey(paths: Sequence[Path], choice: ExportChoice) -> Survey:
    """Read all records once. Raises RecordError and MisuseError."""
    made: Survey | None = None
    for path in paths:
        with Record(path) as record:
            frames = RecordFrames(record, choice.begin, choice.end)
            world = record.description.world
            if made is None:
                kind, chosen = _kind(record, choice)
                actions = Actions.of(choice.act, kind, world.vocabulary)
                made = Survey(kind, world.vocabulary, world.name, world.dt, actions, chosen)
            elif made.dt != world.dt or plain_vocabulary(made.vocabulary) != plain_vocabulary(
                world.vocabulary
            ):
                raise MisuseError(f"lerobot: {path} is of another world than {paths[0]}")
            _add(made, path, frames, choice.every)
    if made is None or not made.episodes:
        raise MisuseError("lerobot: no agent to export; choose others with --agents")
    return made


def _add(made: Survey, path: Path, frames: RecordFrames, every: int) -> None:
    """Add the episodes of a record."""
    episodes: dict[str, Episode] = {}
    for frame in frames:
        ids = made.agents(frame)
        if frame.number == frames.length:
            break  # The string after the last frame: no action follows.
        made.actions.survey(frame.after)
        for message in frame.readings:
            for reading in message.readings:
                if reading.robot in episodes or reading.robot in ids:
                    _learn(made, message.topic, reading)
        if (frame.number - frames.begin) % every:
            continue
        for agent in ids:
            if agent not in episodes:
                number = len(made.episodes)
                episodes[agent] = Episode(number, path, agent, frame.number)
                made.episodes.append(episodes[agent])
            episodes[agent].length += 1
        if len(episodes) > MAX_EPISODES:
            raise MisuseError(
                f"lerobot: {path} has more than {MAX_EPISODES} agents {made.kind.name}; choose"
                " some by id with --agents"
            )


def _learn(made: Survey, topic: str, reading: Reading) -> None:
    """Note the layout of a sensor's data. Raises MisuseError if it has another one elsewhere."""
    if isinstance(reading, Image) and reading.encoding == "32FC1":
        return  # The images of a dataset are files of 8 bits.
    if isinstance(reading, Image):
        layout: object = (reading.height, reading.width, 1 if reading.encoding == "mono8" else 3)
        known: dict[str, object] = made.images  # pyright: ignore[reportAssignmentType]
    else:
        layout, known = reading_names(reading), made.vectors  # pyright: ignore[reportAssignmentType]
    if layout and known.setdefault(topic, layout) != layout:
        raise MisuseError(
            f"lerobot: {topic} of {reading.robot} changes its size; export frames, agents and"
            " records in which sensors are the same"
        )


def _kind(record: Record, choice: ExportChoice) -> tuple[AgentKind, frozenset[str]]:
    """The kind whose lives are episodes, and the ids that were chosen; empty: all."""
    world = record.description.world
    kinds = world.vocabulary.kinds
    named = [name for name in choice.agents if name in kinds]
    ids = frozenset(choice.agents) - set(named)
    if not named:
        present = list(kinds_in(world.scene))
        named = [name for name in present if ids & _ids(record, kinds[name])] if ids else present
    if len(named) != 1:
        there = ", ".join(named or kinds_in(world.scene)) or "none"
        raise MisuseError(
            f"lerobot: episodes are of one kind of agents; choose it, or ids of its agents, with"
            f" --agents: {there}"
        )
    return kinds[named[0]], ids


def _ids(record: Record, kind: AgentKind) -> set[str]:
    rows = agent_rows(record.description.world.scene, kind.name, kind.fields)
    return set(texts(rows.ids()).tolist())
