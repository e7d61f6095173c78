"""The data of a record's plot: tracks of agents, their number, and distances to their goals.

An agent's goal is a label in the static part of the string: its attribute `objective` is the text
of the label.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from minerva_analysis.frame_texts import kinds_in
from minerva_analysis.places import Numbers, Positions, Surveyor, without_agents
from minerva_bus.grammar.appearance import Label, Shape
from minerva_bus.grammar.scene import FigureNode, Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.record import Record
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry

MAX_AGENTS: Final = 300
"""Agents in columns whose tracks are drawn, per kind: every n-th."""

MAX_SAMPLES: Final = 2000
"""Frames of a long record at which places are sampled."""

OBJECTIVE: Final = "objective"


@dataclass(slots=True)
class Track:
    """The places of an agent: simulated times in seconds, x and y in metres, and its last angle."""

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
    """The data of a record's plot.

    `tracks` by agent; `counts` of each kind over `times`; `distances` of agents to their goals as
    (times, metres), NaN while they have none, and the places of their last `goals`. Per frame: the
    number of `events`, and the wall time of its end in `seconds`.
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
        """Whether an agent exists at the end."""
        return track.times[-1] >= self.times[-1]


def story_of(record: Record) -> Story:
    """Read a whole record. Raises RecordError."""
    world = record.description.world
    sampler = _Sampler(world.scene, world.vocabulary)
    every = max(1, sum(1 for _ in record.timings()) // MAX_SAMPLES)
    sampler.sample(0.0, world.scene)
    seconds: list[float] = []
    events: list[int] = []
    for frame, scene in record.strings():
        seconds.append(frame.seconds)
        events.append(sum(map(len, frame.events)))
        if frame.number % every == 0:
            # The string is the one with which the next frame begins.
            sampler.sample((frame.number + 1) * world.dt, scene)
    return Story(
        sampler.ground,
        world.vocabulary,
        sampler.tracks,
        sampler.times,
        sampler.counts,
        sampler.distances,
        sampler.goals,
        events,
        np.array(seconds),
    )


class _Sampler:
    """Collects the samples of a story."""

    def __init__(self, scene: Scene, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self.ground = without_agents(scene)
        self.tracks: dict[str, Track] = {}
        self.times: list[float] = []
        self.counts: dict[str, list[int]] = {}
        self.distances: dict[str, tuple[list[float], list[float]]] = {}
        self.goals: dict[str, tuple[float, float]] = {}
        self._surveyor = Surveyor(vocabulary, MAX_AGENTS)
        # Labels do not move: they are in the part of the string without agents.
        self._labels = labels(self.ground, vocabulary)
        self._seekers = frozenset(
            kind.name for kind in vocabulary.kinds.values() if OBJECTIVE in kind.fields.names
        )

    def sample(self, time: float, scene: Scene) -> None:
        """Add the places of all agents at a time."""
        present = kinds_in(scene)
        for kind in {**self.counts, **present}:
            # A kind that appears later had no agents in the samples before.
            known = self.counts.setdefault(kind, [0] * len(self.times))
            known.append(present.get(kind, 0))
        self.times.append(time)
        kinds = self._surveyor.places(scene)
        for places in kinds.values():
            self._follow(time, places)
        if self._labels and self._seekers & kinds.keys():
            self._measure(time, scene)

    def _follow(self, time: float, places: Positions) -> None:
        columns = places.x.tolist(), places.y.tolist(), places.angle.tolist()
        for agent, x, y, angle in zip(places.ids, *columns, strict=True):
            track = self.tracks.get(agent)
            if track is None:
                track = self.tracks[agent] = Track(places.kind, agent)
            track.times.append(time)
            track.x.append(x)
            track.y.append(y)
            track.angle = angle

    def _measure(self, time: float, scene: Scene) -> None:
        for agent in agents(scene):
            goal: Any = agent.state.get(OBJECTIVE) if agent.symbol in self._seekers else None
            track = self.tracks.get(agent.id)
            if track is None or not isinstance(goal, str) or goal not in self._labels:
                if agent.id in self.distances:
                    self._add_distance(agent.id, time, np.nan)  # A gap in the curve.
                continue
            x, y = self.goals[agent.id] = self._labels[goal]
            self._add_distance(agent.id, time, np.hypot(track.x[-1] - x, track.y[-1] - y))

    def _add_distance(self, agent: str, time: float, distance: float) -> None:
        times, metres = self.distances.setdefault(agent, ([], []))
        times.append(time)
        metres.append(float(distance))


class _Labels(PlaneGeometry):
    """A geometry that collects the places of labels."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.places: dict[str, tuple[float, float]] = {}

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        if isinstance(shape, Label):
            text = str(figure.parameters[shape.text])
            self.places.setdefault(text, (self.pose.x, self.pose.y))


def labels(ground: Scene, vocabulary: Vocabulary) -> dict[str, tuple[float, float]]:
    """The places of the labels in a string without agents, metres."""
    geometry = _Labels(vocabulary)
    interpret(ground, geometry)
    return geometry.places
