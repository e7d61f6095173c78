"""Which colour an agent has in a picture: its own where few move, else that of its kind."""

from __future__ import annotations

from collections import Counter
from typing import Any, Final

from minerva_bus.study.tracks import Story, Track

COLORS: Final = (
    "#d9641e",
    "#2f6f8f",
    "#b3205f",
    "#4f8049",
    "#7b4aa0",
    "#a8790a",
    "#3d4fa3",
    "#7d6b5d",
)
GONE: Final = "#8a929c"
OWN: Final = 4
"""So many agents that move have colours of their own."""

FEW: Final = 8
"""So many of a kind have broad tracks."""


class Palette:
    """Colours of agents and kinds of one picture."""

    def __init__(self, story: Story) -> None:
        tracks = list(story.tracks.values())
        movers = [track for track in tracks if track.moves]
        own = [track.agent for track in movers] if len(movers) <= OWN else []
        self._own = frozenset(own)
        self._moving = frozenset(map(self._name, movers))
        self._sizes = Counter(track.kind for track in tracks)
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
        """Whether an agent is one of few of its kind."""
        return self._sizes[track.kind] <= FEW

    def size(self, track: Track) -> int:
        """How many agents of its kind are drawn."""
        return self._sizes[track.kind]

    def handles(self) -> list[Any]:
        """What a legend shows."""
        from matplotlib.lines import Line2D

        handles = [
            Line2D(
                [],
                [],
                color=self._colors[name],
                linestyle="-" if name in self._moving else "",
                marker="o",
                markersize=5,
                label=name,
            )
            for name in self._shown
        ]
        if self._gone:
            handles.append(Line2D([], [], color=GONE, marker="x", linestyle="", label="gone"))
        return handles
