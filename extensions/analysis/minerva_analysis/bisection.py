"""Why two runs part: `minerva bisect A [B]`.

The first frame that differs has other events or, with the same events, another string after it.
Other events lead to the source that sent them; an agent's event and an agent's state lead to the
method that made them, which runs again on the recorded inputs, with the code of each side.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from minerva_analysis.causes import person_behind, sources_of
from minerva_analysis.comparing import (
    Difference,
    compare,
    same_events,
    starts_apart,
    without_views,
)
from minerva_analysis.first_cause import CauseAnswer, CauseQuestion, SourceFunction
from minerva_analysis.past_frames import PastFrame, past_frames
from minerva_analysis.replays import no_progress
from minerva_analysis.swapping import run_again
from minerva_bus.errors import MinervaError, WorldStopped
from minerva_bus.frame.stimuli import AGENTS, is_people
from minerva_bus.grammar.events import Event, single
from minerva_bus.launch.past import differing_vocabulary
from minerva_bus.log.record import Record
from minerva_bus.values import path_of
from minerva_bus.wording import short

SECONDS: Final = 60.0
"""Longest time for an answer of one side."""
MAX_FUNCTIONS: Final = 5


@dataclass(frozen=True, slots=True)
class FunctionDifference:
    """A function that differs: its first line that does, in A and in B; empty where it is missing.

    A function with the name of a module is all that the module has outside of functions.
    """

    function: str
    a: str
    b: str


@dataclass(frozen=True, slots=True)
class Parting:
    """The first frame in which two runs differ, and why.

    `cause` names the agent, member or person whose result differs first, and `frame` the frame in
    which it does: an agent's event counts a frame later. `why` has the steps that led there on
    each side. `functions` differ between the code of the sides. `remark`: what the code computes
    now.
    """

    difference: Difference
    cause: str = ""
    frame: int = -1
    why: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    functions: tuple[FunctionDifference, ...] = ()
    remark: str = ""

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        own = {"cause": self.cause, "cause_frame": self.frame, "remark": self.remark}
        functions = [asdict(each) for each in self.functions]
        a, b = self.why
        return {**self.difference.plain(), **own, "why": {"a": a, "b": b}, "functions": functions}

    def lines(self) -> list[str]:
        """As lines of text."""
        shown = self.difference.lines()
        if not self.cause:
            return shown
        shown.append(f"cause: {self.cause}")
        for side, steps in zip(self.difference.sides, self.why, strict=True):
            shown += [f"  {side}:", *(f"    {step}" for step in steps)] if steps else []
        for each in self.functions[:MAX_FUNCTIONS]:
            shown.append(f"the code differs: {each.function}")
            for side, line in zip(self.difference.sides, (each.a, each.b), strict=True):
                shown.append(f"  {side}: {line or 'not there'}")
        more = len(self.functions) - MAX_FUNCTIONS
        shown += [f"and {more} more functions"] if more > 0 else []
        return [*shown, *([self.remark] if self.remark else [])]


def bisect(
    a: str | Path,
    b: str | Path | None = None,
    *,
    world_a: str = "",
    world_b: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> Parting:
    """Why two records differ, or a record and a run with today's code.

    The first frame that differs is computed again from its recorded inputs, with the code of each
    record.

    Args:
        a: a record, .mcap.
        b: another record; None: the code of `world_b` runs again on the inputs of `a`.
        world_a: the world file with the code of `a`; "": the one that the record names.
        world_b: that of `b`; "": the same.
        progress: called with the number of frames that were run again, and the total.

    Returns:
        The first difference and its cause; `difference.same` if there is none.

    Raises:
        RecordError: a record cannot be read.
        WorldFileError: there is no such world file.
        MinervaError: a record or a world file is that of another world.
        WorldStopped: the code fails when it runs again.

    """
    first = path_of("a", a)
    if b is not None:
        return _parting(first, path_of("b", b), ("A", "B"), world_a, world_b)
    with TemporaryDirectory(prefix="minerva-") as folder:
        again = Path(folder) / "again.mcap"
        run_again(first, world_b or world_a, str(again), progress or no_progress)
        sides = ("the record", "today's code")
        return _parting(first, again, sides, world_a, world_b or world_a)


def _parting(a: Path, b: Path, sides: tuple[str, str], world_a: str, world_b: str) -> Parting:
    with Record(a) as first, Record(b) as second:
        worlds = [record.description.world for record in (first, second)]
        if worlds[0].name != worlds[1].name and differing_vocabulary(
            *[world.vocabulary for world in worlds]
        ):
            names = f"{worlds[1].name!r}, not of {worlds[0].name!r} as {a}"
            raise MinervaError(f"{b}: it is the record of another world, {names}")
        difference = replace(compare(first, second), sides=sides)
        number = difference.frame
        if number is None:
            return Parting(difference)
        begun = "; ".join(starts_apart(first, second))
        in_a, in_b = (_past_frame(each, number) for each in (first, second))
    if in_a is None or in_b is None or in_a.frame.number != in_b.frame.number:
        return Parting(difference)
    asked = (CauseQuestion(str(a), world_a, number), CauseQuestion(str(b), world_b, number))
    parting = _of_frame(difference, asked, (in_a, in_b))
    if begun and not parting.functions:
        # The same code on other inputs, whose results say nothing of the code.
        return replace(parting, remark=f"the runs begin differently: {begun}")
    return parting


def _past_frame(record: Record, number: int) -> PastFrame | None:
    past = next(past_frames(record, number, number + 1), None)
    if past is None:
        return None
    return replace(past, frame=without_views(past.frame, record.description.world.vocabulary))


def _of_frame(
    difference: Difference,
    asked: tuple[CauseQuestion, CauseQuestion],
    pasts: tuple[PastFrame, PastFrame],
) -> Parting:
    """The cause of the first difference of a frame."""
    number = pasts[0].frame.number
    if not same_events(*[past.frame.events for past in pasts]):
        return _of_events(difference, asked, pasts)
    for change in difference.changes:
        agent = change.agent.partition("#")[2]
        if agent:
            attribute = change.attribute.partition("[")[0]
            both = [replace(each, agent=agent, attribute=attribute) for each in asked]
            what = f"{attribute} of " if attribute else ""
            return _answered(difference, f"{what}{change.agent} in frame {number}", both)
    return Parting(difference, "the string outside of agents, or their order", number)


def _of_events(
    difference: Difference,
    asked: tuple[CauseQuestion, CauseQuestion],
    pasts: tuple[PastFrame, PastFrame],
) -> Parting:
    """The cause of other events: the first source that sent others."""
    number, in_a, in_b = pasts[0].frame.number, *map(sources_of, pasts)
    # What agents have sent is older than what the others have sent.
    for source in sorted({*in_a, *in_b}, key=lambda name: (name != AGENTS, name)):
        sent = list(single(in_a.get(source, ()))), list(single(in_b.get(source, ())))
        if sent[0] == sent[1]:
            continue
        if source == AGENTS:
            return _of_agents(difference, asked, sent)
        if any(is_people(source) or source in past.people for past in pasts):
            who = person_behind(source, number).text if is_people(source) else source
            lines = tuple([f"{who} sent {short(str(event))}" for event in each] for each in sent)
            why = tuple(lines[0]), tuple(lines[1])
            return Parting(difference, f"{who} sent other events for frame {number}", number, why)
        both = [replace(each, member=source) for each in asked]
        return _answered(difference, f"the events of {source} for frame {number}", both)
    cause = "norms, or the order of events"
    if any(past.frame.inputs is None for past in pasts):
        cause = "a member or a person: the records lack the inputs of members"
    return Parting(difference, cause, number)


def _of_agents(
    difference: Difference,
    asked: tuple[CauseQuestion, CauseQuestion],
    sent: tuple[list[Event], list[Event]],
) -> Parting:
    """The cause of other events of agents: the first agent that sent another, a frame before."""
    places = _first_without(sent[0], sent[1]), _first_without(sent[1], sent[0])
    if places == (-1, -1):
        # The same events in another order.
        place = next(n for n, (x, y) in enumerate(zip(*sent, strict=False)) if x != y)
        places = place, place
    sender = next(
        events[place].sender for events, place in zip(sent, places, strict=True) if place >= 0
    )
    number = asked[0].frame - 1
    both = [
        replace(
            question,
            frame=number,
            agent=sender,
            sent=True,
            place=place if place >= 0 and events[place].sender == sender else -1,
        )
        for question, events, place in zip(asked, sent, places, strict=True)
    ]
    return _answered(difference, f"the events that #{sender} sent in frame {number}", both)


def _first_without(events: list[Event], others: list[Event]) -> int:
    """The place of the first event that the others lack; -1 if there is none."""
    known = set(others)
    return next((place for place, event in enumerate(events) if event not in known), -1)


def _answered(difference: Difference, cause: str, asked: Sequence[CauseQuestion]) -> Parting:
    """The cause with the answers of both sides. Raises MinervaError."""
    running = [_ask(question, seed) for seed, question in enumerate(asked)]
    try:
        a, b = [_answer(process) for process in running]
    finally:
        for process in running:
            process.kill()
            process.communicate()
    functions = tuple(_differing(a.functions, b.functions))
    remark = "" if functions else _remark(a, b, *difference.sides)
    return Parting(difference, cause, asked[0].frame, (a.lines, b.lines), functions, remark)


def _ask(question: CauseQuestion, seed: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "minerva_analysis.first_cause"]
    process = subprocess.Popen(  # noqa: S603
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Another order of sets on each side.
        env={**os.environ, "PYTHONHASHSEED": str(seed)},
    )
    assert process.stdin is not None
    process.stdin.write(json.dumps(asdict(question)))
    process.stdin.close()
    process.stdin = None
    return process


def _answer(process: subprocess.Popen[str]) -> CauseAnswer:
    try:
        printed, problems = process.communicate(timeout=SECONDS)
    except subprocess.TimeoutExpired:
        raise MinervaError(
            f"the code of the frame did not return within {SECONDS:g} s when it ran again"
        ) from None
    if process.returncode:
        error = WorldStopped if process.returncode == 1 else MinervaError
        raise error(problems.strip() or "a process ended without an answer")
    return CauseAnswer.of_plain(json.loads(printed.splitlines()[-1]))


def _differing(
    a: Mapping[str, SourceFunction], b: Mapping[str, SourceFunction]
) -> Iterator[FunctionDifference]:
    for name in sorted({*a, *b}):
        x, y = a.get(name), b.get(name)
        if x is None or y is None:
            yield FunctionDifference(name, *(f"{f.file}:{f.line}" if f else "" for f in (x, y)))
            continue
        pairs = zip_longest(_numbered(x), _numbered(y), fillvalue=(0, "its end"))
        for (number_a, line_a), (number_b, line_b) in pairs:
            if line_a != line_b:
                yield FunctionDifference(name, _at(x, number_a, line_a), _at(y, number_b, line_b))
                break


def _numbered(function: SourceFunction) -> list[tuple[int, str]]:
    """The lines of a function that are not blank, with their numbers."""
    lines = enumerate(function.text.split("\n"), function.line)
    return [(number, line) for number, line in lines if line.strip()]


def _at(function: SourceFunction, number: int, line: str) -> str:
    return f"{function.file}:{number}  {line.strip()}" if number else line


def _remark(a: CauseAnswer, b: CauseAnswer, first: str, second: str) -> str:
    """What the same code computes now on both sides."""
    if a.computed != b.computed:
        return (
            "the code is not deterministic: from the same inputs two processes computed"
            f" {short(a.computed)} and {short(b.computed)}"
        )
    if not a.computed:
        return ""
    same = [side for answer, side in ((a, first), (b, second)) if answer.repeated]
    as_in = f", as in {' and '.join(same)}" if same else ", unlike both"
    return (
        f"the code computes {short(a.computed)} now{as_in}: it has changed, or depends on more than"
        " the string, the events and the random stream"
    )
