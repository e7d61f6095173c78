"""Colours of agents in a plot: a colour per agent if few of them move, otherwise per kind."""

from __future__ import annotations

from collections import Counter
from typing import Any, Final

from minerva_bus.plotting import COLORS
from minerva_bus.study.tracks import Story, Track

GONE: Final = "#8a929c"
MAX_OWN: Final = 4
"""Number of moving agents up to which each has its own colour."""

MAX_BROAD: Final = 8
"""Number of agents of a kind up to which they have broad tracks."""


class Palette:
    """The colours of agents and kinds in one plot."""

    def __init__(self, story: Story) -> None:
        tracks = list(story.tracks.values())
        movers = [track for track in tracks if track.moves]
        own = [track.agent for track in movers] if len(movers) <= MAX_OWN else []
        self._own = frozenset(own)
        self._moving = frozenset(map(self._name, movers))
        self._sizes = Counter(track.kind for track in tracks)
        # Moving agents come first: the colours repeat, and those with tracks need different ones
        # most.
        names = [self._name(track) for track in movers]
        names += [self._name(track) for track in tracks]
        names += story.counts
        ordered = dict.fromkeys(names)
        self._colors = {name: COLORS[n % len(COLORS)] for n, name in enumerate(ordered)}
        self._shown = tuple(dict.fromkeys(map(self._name, [*movers, *tracks])))
        self._gone = any(not story.is_there(track) for track in tracks)

    def _name(self, track: Track) -> str:
        return track.agent if track.agent in self._own else track.kind

    def of(self, track: Track) -> str:
        """The colour of an agent."""
        return self._colors[self._name(track)]

    def of_kind(self, kind: str) -> str:
        """The colour of a kind."""
        return self._colors[kind]

    def broad(self, track: Track) -> bool:
        """Whether an agent has a broad track: there are few of its kind."""
        return self._sizes[track.kind] <= MAX_BROAD

    def size(self, track: Track) -> int:
        """The number of agents of its kind."""
        return self._sizes[track.kind]

    def handles(self) -> list[Any]:
        """The entries of the legend."""
        from matplotlib.lines import Line2D

        handles = [
            Line2D(
                [],
                [],
                color=self._colors[name],
                marker="o",
                markersize=5,
                label=name,
                linestyle="-" if name in self._moving else "",
            )
            for name in self._shown
        ]
        if self._gone:
            handles.append(Line2D([], [], color=GONE, marker="x", linestyle="", label="gone"))
        return handles
