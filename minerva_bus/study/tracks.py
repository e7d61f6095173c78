"""What is drawn of a record: where agents have been, how many there were, how far from their goal.

An agent's goal is a place with a label in the static part of the string: the agent has an
attribute `objective` that is the label's text.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from minerva_bus.grammar.forms import Label, Shape
from minerva_bus.grammar.scene import FigureNode, Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.info import kinds_in
from minerva_bus.log.places import Numbers, Positions, Surveyor
from minerva_bus.log.reader import Record
from minerva_bus.log.showing import without_agents
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry

AGENTS: Final = 300
"""Of a kind in columns so many are followed, every n-th."""

SAMPLES: Final = 2000
"""Frames of a long record at which it is looked where agents are."""

OBJECTIVE: Final = "objective"


@dataclass(slots=True)
class Track:
    """Where one agent has been: times in seconds of the world, x and y in metres, and angle."""

    kind: str
    agent: str
    times: list[float] = field(default_factory=list[float])
    x: list[float] = field(default_factory=list[float])
    y: list[float] = field(default_factory=list[float])
    angle: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether the agent has been at more than one place."""
        return len(set(self.x)) > 1 or len(set(self.y)) > 1


@dataclass(frozen=True, slots=True)
class Story:
    """A record as it is drawn.

    `tracks` by agent; `counts` of each kind over `times`; `distances` of agents to their goals as
    (times, metres), and where the last `goals` are. Of each frame, how many `events` it had, and
    the `seconds` by the clock at which it was over.
    """

    ground: Scene
    vocabulary: Vocabulary
    tracks: Mapping[str, Track]
    times: list[float]
    counts: Mapping[str, list[int]]
    distances: Mapping[str, tuple[list[float], list[float]]]
    goals: Mapping[str, tuple[float, float]]
    events: list[int]
    seconds: Numbers

    def is_there(self, track: Track) -> bool:
        """Whether an agent is still there at the end."""
        return track.times[-1] >= self.times[-1]


def story_of(record: Record) -> Story:
    """Read all of a record. Raises RecordError."""
    world = record.description.world
    telling = _Telling(world.scene, world.vocabulary)
    every = max(1, sum(1 for _ in record.timings()) // SAMPLES)
    telling.look(0.0, world.scene)
    seconds: list[float] = []
    events: list[int] = []
    for frame, scene in record.strings():
        seconds.append(frame.seconds)
        events.append(sum(map(len, frame.events)))
        if frame.number % every == 0:
            telling.look((frame.number + 1) * world.dt, scene)
    return Story(
        telling.ground,
        world.vocabulary,
        telling.tracks,
        telling.times,
        telling.counts,
        telling.distances,
        telling.goals,
        events,
        np.array(seconds),
    )


class _Telling:
    """A story in the making."""

    def __init__(self, scene: Scene, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self.ground = without_agents(scene)
        self.tracks: dict[str, Track] = {}
        self.times: list[float] = []
        self.counts: dict[str, list[int]] = {}
        self.distances: dict[str, tuple[list[float], list[float]]] = {}
        self.goals: dict[str, tuple[float, float]] = {}
        self._surveyor = Surveyor(vocabulary, AGENTS)
        self._labels = labels(self.ground, vocabulary)
        self._seekers = frozenset(
            kind.name for kind in vocabulary.kinds.values() if OBJECTIVE in kind.fields.names
        )

    def look(self, time: float, scene: Scene) -> None:
        """Note where all are at a time."""
        found = kinds_in(scene)
        for kind in {**self.counts, **found}:
            known = self.counts.setdefault(kind, [0] * len(self.times))
            known.append(found.get(kind, 0))
        self.times.append(time)
        there = self._surveyor.places(scene)
        for some in there.values():
            self._follow(time, some)
        if self._labels and self._seekers & there.keys():
            self._measure(time, scene)

    def _follow(self, time: float, some: Positions) -> None:
        rows = zip(some.ids, some.x.tolist(), some.y.tolist(), some.angle.tolist(), strict=True)
        for agent, x, y, angle in rows:
            track = self.tracks.get(agent)
            if track is None:
                track = self.tracks[agent] = Track(some.kind, agent)
            track.times.append(time)
            track.x.append(x)
            track.y.append(y)
            track.angle = angle

    def _measure(self, time: float, scene: Scene) -> None:
        for agent in agents(scene):
            goal: Any = agent.state.get(OBJECTIVE) if agent.symbol in self._seekers else None
            track = self.tracks.get(agent.id)
            if track is None or not isinstance(goal, str) or goal not in self._labels:
                continue
            x, y = self.goals[agent.id] = self._labels[goal]
            times, metres = self.distances.setdefault(agent.id, ([], []))
            times.append(time)
            metres.append(float(np.hypot(track.x[-1] - x, track.y[-1] - y)))


class _Labels(PlaneGeometry):
    """A geometry in which labels are places by name."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.found: dict[str, tuple[float, float]] = {}

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        if isinstance(shape, Label):
            text = str(figure.parameters[shape.text])
            self.found.setdefault(text, (self.pose.x, self.pose.y))


def labels(ground: Scene, vocabulary: Vocabulary) -> dict[str, tuple[float, float]]:
    """Where the labels of a string without agents stand, metres."""
    geometry = _Labels(vocabulary)
    interpret(ground, geometry)
    return geometry.found
