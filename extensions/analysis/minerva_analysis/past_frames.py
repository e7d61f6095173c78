"""Frames of a record with the string before and after each, and the last change of an attribute.

The record may be that of a running world, whose last frames are not yet on the disk.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from minerva_analysis.frame_texts import frames_up_to
from minerva_bus.errors import MisuseError, RecordError, nearest
from minerva_bus.frame.stimuli import Checkpoint, RecordedFrame
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene, Value, agents
from minerva_bus.grammar.text_and_digest import same_values
from minerva_bus.log.record import Cursor, Record

MAX_NAMED: Final = 20

RECORD_SECONDS: Final = 10.0
"""Longest time, in seconds, that a running world takes to write its frames to the disk."""

POLL_SECONDS: Final = 0.05


@dataclass(frozen=True, slots=True)
class PastFrame:
    """A frame with its initial string and state, and the string after it.

    `checkpoint` is None if the record does not have it.
    """

    before: Scene
    checkpoint: Checkpoint | None
    frame: RecordedFrame
    after: Scene

    @property
    def people(self) -> tuple[str, ...]:
        """Members whose events are those of people; none in a record without inputs."""
        return self.frame.inputs.people if self.frame.inputs is not None else ()


@dataclass(frozen=True, slots=True)
class ValueChange:
    """The frame in which an attribute got its value; the agent is None where it did not exist.

    `frame` is -1 for a value of the initial string, or of the first string of a record that lacks
    the frames before it. `gap`: frames before it are lost, so the change may have happened in them.
    """

    frame: int
    before: AgentNode | None
    after: AgentNode
    gap: bool = False


def agent_in(scene: Scene, name: str) -> AgentNode | None:
    """The agent with an id, at any depth, or None."""
    return next((agent for piece in scene.pieces if (agent := _agent_in(piece, name))), None)


def piece_around(scene: Scene, name: str) -> Scene:
    """The part of a string that is the agent with an id, or contains it; else an empty string."""
    for piece in scene.pieces:
        agent = _agent_in(piece, name)
        if agent is not None:
            return Scene((agent if piece.ids is not None else piece,))
    return EMPTY


def _agent_in(piece: Piece, name: str) -> AgentNode | None:
    if piece.ids is not None:
        rows = piece.ids.rows_of(Ids.of([name])).tolist()
        node = piece.node(rows[0]) if rows[0] >= 0 else None
        return node if isinstance(node, AgentNode) else None
    if piece.still:
        return None
    return next((agent for agent in agents(Scene((piece,))) if agent.id == name), None)


def last_change(record: Record, name: str, attribute: str, end: int) -> ValueChange:
    """The frame before `end` in which an attribute got the value that it has when `end` begins.

    Reads backwards from keyframe to keyframe, so recent changes of long runs are found fast.

    Raises:
        RecordError: there is no such agent or attribute at the beginning of frame `end`.

    """
    number, newest, first = end, None, record.initial.number
    while True:
        keyframe, chunk = record.keyframe(number - 1) if number > first else (record.initial, 0)
        cursor = Cursor(record, events=False)
        cursor.start(keyframe, chunk)
        change, last = _change_since(cursor, name, attribute, number)
        if newest is None:
            if last is None:
                raise _missing(record, name, end)
            _check_attribute(record, last, attribute)
            newest = last
        if change is not None:
            return change
        if keyframe.number == first:
            return ValueChange(-1, None, newest, gap=first > 0)
        number = keyframe.number


def _change_since(
    cursor: Cursor, name: str, attribute: str, end: int
) -> tuple[ValueChange | None, AgentNode | None]:
    """The last change in the frames of a cursor up to `end`, and the agent at the end."""
    agent, change = agent_in(cursor.scene, name), None
    # Without the first condition, the next chunk would be unpacked for a frame beyond the end.
    while cursor.number < end and (ahead := cursor.ahead) is not None and ahead.number < end:
        gap = ahead.number != cursor.number
        before, scene = agent, cursor.advance()
        # An unchanged agent is the same object, which saves the search.
        if not any(agent is piece for piece in scene.pieces):
            agent = agent_in(scene, name)
        if agent is not None and agent is not before and not same_value(before, agent, attribute):
            change = ValueChange(ahead.number, before, agent, gap)
    return change, agent


def same_value(a: AgentNode | None, b: AgentNode, attribute: str) -> bool:
    """Whether an attribute has the same value in two states of an agent; not if one is None."""
    return a is not None and same_values((value_of(a, attribute),), (value_of(b, attribute),))


def value_of(agent: AgentNode, attribute: str) -> Value:
    """The value of an attribute; an empty text if the agent has none of this name."""
    return agent.state.get(attribute, "")


def agent_at(record: Record, name: str, end: int) -> AgentNode:
    """The agent with an id at the beginning of a frame. Raises RecordError if there is none."""
    agent = agent_in(record.string(end), name)
    if agent is None:
        raise _missing(record, name, end)
    return agent


def _missing(record: Record, name: str, end: int) -> RecordError:
    died = _last_frame_of(record, name, end)
    if died is not None:
        return RecordError(
            f"{record.path}: #{name} disappeared in frame {died};"
            f" --frame {died} explains its last value"
        )
    known = [agent.id for agent in agents(record.string(end))]
    hint = nearest(name, known, f"there are {', '.join(known[:MAX_NAMED])}")
    return RecordError(f"{record.path}: frame {end} has no agent #{name[:64]}{hint}")


def _last_frame_of(record: Record, name: str, end: int) -> int | None:
    """The frame in which an agent disappeared, or None."""
    cursor, there, died = Cursor(record, events=False), False, None
    while (ahead := cursor.ahead) is not None and ahead.number < end:
        there = agent_in(cursor.scene, name) is not None
        gone = agent_in(cursor.advance(), name) is None
        died = ahead.number if there and gone else died
    return died


def _check_attribute(record: Record, agent: AgentNode, attribute: str) -> None:
    if attribute not in agent.names:
        hint = nearest(attribute, [*agent.names], f"it has {', '.join(agent.names)}")
        raise RecordError(f"{record.path}: {agent.symbol} has no attribute {attribute!r}{hint}")


def past_frames(record: Record, begin: int, end: int) -> Iterator[PastFrame]:
    """The frames from `begin` up to `end`, with inputs and state as far as recorded."""
    cursor = Cursor(record, state=True, inputs=True)
    cursor.skip_to(max(0, begin))
    while (frame := cursor.ahead) is not None and frame.number < end:
        cursor.settle()
        before, checkpoint = cursor.scene, cursor.checkpoint
        yield PastFrame(before, checkpoint, frame, cursor.advance())


def end_of(record: Record, frame: int | None) -> int:
    """The number of a frame whose initial string is asked for; None: the end of the record.

    Raises RecordError if the record does not have it.
    """
    first, end = record.initial.number, record.last()[0]
    if frame is None:
        return end
    if not first <= frame <= end:
        known = f"frames {first} to {end}" if first else frames_up_to(end)
        raise RecordError(f"{record.path}: it has {known}, not {frame}")
    return frame


# --- the record of a running world ---


def wait_for_frame(path: Path, frame: int) -> None:
    """Wait until a frame of a record is on the disk. Raises MisuseError after RECORD_SECONDS."""
    until = time.monotonic() + RECORD_SECONDS
    while (last := _last(path)) < frame:
        if time.monotonic() > until:
            raise MisuseError(
                f"{path} ends with frame {last}, not {frame}, after {RECORD_SECONDS:g} s; flush it"
                " more often (--flush), or choose an earlier frame"
            )
        time.sleep(POLL_SECONDS)


def last_written(path: Path) -> int:
    """The frame whose initial string is the last on the disk; -1 if the record cannot be read."""
    try:
        return _last(path)
    except RecordError:
        return -1


def _last(path: Path) -> int:
    with Record(path) as record:
        return record.last()[0]
