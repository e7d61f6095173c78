"""Questions about the latest frames of a running world, which its journal has as inputs.

They have to be repeated, at about a millisecond each, so the search for a change begins at the
last keyframe of the journal and goes back only as far as needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from minerva_bus.errors import RecordError
from minerva_bus.launch.past import WorldSource
from minerva_bus.launch.replays import explained_in
from minerva_bus.launch.temporary_folder import temporary_folder
from minerva_bus.log.causes import MAX_LINKS, RECENT
from minerva_bus.log.explanation import Explanation
from minerva_bus.log.journaled import keyframes_in
from minerva_bus.log.observation import Observation
from minerva_bus.log.recent import recent_record


@dataclass(frozen=True, slots=True)
class JournaledPast:
    """The past of an agent's attribute in a journal; the fields are those of `explained_in`."""

    journal: Path
    code: WorldSource | None
    agent: str
    attribute: str

    def explain(self, frame: int | None, wanted: int, written: int) -> Explanation | Observation:
        """How the attribute got its value, or that it is older than the frames that were repeated.

        `wanted` is the number of the frame, `written` the last one of the world's record, which has
        the frames before the first keyframe that is not after it. Raises RecordError.
        """
        starts = starts_before(keyframes_in(self.journal), wanted)
        for begin in starts[:-1]:
            try:
                explanation, first = self._since(begin, frame)
            except RecordError:
                continue  # The agent may have disappeared before these frames.
            if isinstance(explanation, Observation) or explanation.since >= first + MAX_LINKS:
                return explanation
            if explanation.is_older and first <= written:
                return explanation
        return self._since(starts[-1], frame)[0]

    def _since(self, begin: int, frame: int | None) -> tuple[Explanation | Observation, int]:
        with (
            temporary_folder("explain") as folder,
            recent_record(self.journal, folder, begin) as record,
        ):
            explanation = explained_in(record, self.code, self.agent, self.attribute, frame)
            return explanation, record.initial.number


def starts_before(keyframes: Sequence[int], frame: int) -> list[int]:
    """The keyframes from which the frames up to `frame` are repeated, in turn.

    Each time twice as many, so all attempts take at most twice the time of the last. An answer
    needs some frames before its own.
    """
    near = [number for number in reversed(keyframes) if number + RECENT <= frame]
    picked: list[int] = [near[2**n - 1] for n in range((len(near) + 1).bit_length() - 1)]
    first = keyframes[0] if keyframes else 0
    return [*picked, *([] if picked[-1:] == [first] else [first])]


def continued(
    recent: Explanation | Observation, older: Explanation | Observation
) -> Explanation | Observation:
    """An explanation of a value that is the same since the frames of `recent`, by `older` ones."""
    if isinstance(recent, Observation) or isinstance(older, Observation):
        return recent
    return replace(older, frame=recent.frame, value=recent.value, rejected=recent.rejected)
