"""The cause of what a record has in a frame: a change of an agent, or an event that was sent.

A bisection runs this module as a program, once for each of two records: two revisions of a user's
code have modules of the same names, and the order of a set differs between processes. The question
and the answer are JSON.
"""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, Final

from minerva_analysis.causes import (
    Cause,
    Causes,
    event_text,
    origin_of,
    same_event,
    source_of,
    sources_of,
)
from minerva_analysis.past_frames import (
    PastFrame,
    ValueChange,
    agent_in,
    past_frames,
    same_value,
    value_of,
)
from minerva_analysis.replays import world_file_of
from minerva_analysis.traced_calls import TracedCall
from minerva_bus.errors import MinervaError, UserCodeError
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.text_and_digest import shown_value
from minerva_bus.launch.past import kinds_in
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.log.record import Record
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.user_code import defined, is_foreign, report
from minerva_bus.world.services import Generator

MAX_SENT: Final = 3
BEFORE: Final = 5
"""Frames before the question that are read, for the chain of causes."""


@dataclass(frozen=True, slots=True)
class CauseQuestion:
    """What differs in frame `frame` of the record at `path`, with the code of `world`.

    `agent` and `attribute`: a value that became so in this frame, or an agent without attribute.
    `sent`: whether it is an event that the agent sent, number `place` of all events of agents in
    the frame; -1 if only the other record has it. `member`: a generator, and no agent.
    """

    path: str
    world: str
    frame: int
    agent: str = ""
    attribute: str = ""
    sent: bool = False
    place: int = -1
    member: str = ""


@dataclass(frozen=True, slots=True)
class SourceFunction:
    """A function of a user's code, or what a module has outside of functions."""

    file: str
    line: int
    text: str


@dataclass(frozen=True, slots=True)
class CauseAnswer:
    """The steps that led to it, as lines, and what the code computes now from the same inputs.

    `computed` is empty if no code ran. `repeated`: whether it is what the record has. `functions`:
    those of the user's modules, by name.
    """

    lines: tuple[str, ...] = ()
    computed: str = ""
    repeated: bool = False
    functions: Mapping[str, SourceFunction] = field(default_factory=dict[str, SourceFunction])

    @classmethod
    def of_plain(cls, plain: Mapping[str, Any]) -> CauseAnswer:
        """An answer from a JSON object."""
        functions = {name: SourceFunction(**each) for name, each in plain["functions"].items()}
        return cls(tuple(plain["lines"]), plain["computed"], plain["repeated"], functions)


def answered(question: CauseQuestion) -> CauseAnswer:
    """The answer to a question. Raises MinervaError."""
    path, frame = Path(question.path), question.frame
    with Record(path) as record:
        file = world_file_of(path, question.world, record.description, Overrides())
        # The events that agents sent in a frame are part of the state after it.
        past = {each.frame.number: each for each in past_frames(record, frame - BEFORE, frame + 2)}
        if question.member:
            return _generated(question, file, past)
        kinds = kinds_in(file)
        causes = Causes(record.description.world, kinds, past)
    calls = causes.calls(question.agent, frame)
    names = [question.agent, *(call.caller.id for call in calls)]
    both = [
        agent_in(scene, name) for name in names for scene in (past[frame].before, past[frame].after)
    ]
    symbols = {node.symbol for node in both if node is not None}
    functions = _functions([cls for symbol, cls in kinds.items() if symbol in symbols])
    steps = _sent if question.sent else _changed
    return replace(steps(question, causes, past, calls), functions=functions)


def _changed(
    question: CauseQuestion,
    causes: Causes,
    past: Mapping[int, PastFrame],
    calls: Sequence[TracedCall],
) -> CauseAnswer:
    """How the value became so in this record."""
    name, then = question.agent, past[question.frame]
    before, after = agent_in(then.before, name), agent_in(then.after, name)
    made = calls[-1].agent(name) if calls else None
    computed = _value(made, question) if calls else ""
    repeated = computed == _value(after, question)
    attribute = question.attribute or next(iter(after.names if after is not None else ()), "")
    if after is None:
        lines = [f"frame {then.frame.number}: #{name} is no longer there"]
    elif same_value(before, after, attribute):
        lines = [f"frame {then.frame.number}: #{name} keeps {attribute}"]
    else:
        change = ValueChange(then.frame.number, before, after)
        lines = _shown(*causes.of_change(change, attribute))
    return CauseAnswer(tuple(lines), computed, repeated)


def _value(agent: AgentNode | None, question: CauseQuestion) -> str:
    """The agent, or its attribute, in words."""
    if agent is None or not question.attribute:
        return f"#{question.agent} is {'not ' if agent is None else ''}there"
    return shown_value(value_of(agent, question.attribute))


def _sent(
    question: CauseQuestion,
    causes: Causes,
    past: Mapping[int, PastFrame],
    calls: Sequence[TracedCall],
) -> CauseAnswer:
    """How the event came to be sent in this record."""
    frame = question.frame
    emitted = [event for call in calls for event in call.emitted]
    computed = ("; ".join(map(event_text, emitted)) or "no event") if calls else ""
    if question.place < 0:
        return CauseAnswer((f"frame {frame}: #{question.agent} did not send it",), computed)
    after = past.get(frame + 1)
    sent = after.checkpoint.emitted if after is not None and after.checkpoint is not None else ()
    event = next(islice(single(sent), question.place, None))
    repeated = any(same_event(event, each) for each in emitted)
    return CauseAnswer(tuple(_shown(*causes.of_event(event, frame))), computed, repeated)


def _shown(links: Sequence[Cause], origin: str) -> list[str]:
    return [*(line for link in links for line in link.lines()), f"origin: {origin}"]


def _generated(
    question: CauseQuestion, file: WorldFile, past: Mapping[int, PastFrame]
) -> CauseAnswer:
    """The events of a generator, with the orders before them, and its class.

    Its state before the frame is not in a record.
    """
    frame, member = question.frame, question.member
    sent = islice(single(sources_of(past[frame]).get(member, ())), MAX_SENT)
    lines = [origin_of(source_of(event, past, frame, ()), event) for event in sent]
    lines = lines or [f"{member} sent nothing for frame {frame}"]
    process = next((each for each in file.processes if each.name == question.member), None)
    if process is None or process.make_service is None:
        return CauseAnswer(tuple(lines))
    cls = process.make_service.cls
    if issubclass(cls, Generator) and (place := defined(cls.generate)) is not None:
        lines.append(f"  in {cls.__name__}.generate, {place.where}")
    return CauseAnswer(tuple(lines), functions=_functions([cls]))


# --- the code ---


def _functions(classes: Iterable[type]) -> dict[str, SourceFunction]:
    """The functions of users' modules in the folders of classes, by qualified name.

    The name of a module stands for all that it has outside of functions.
    """
    files = {
        name: Path(file)
        for name, module in sorted(sys.modules.items())
        if (file := getattr(module, "__file__", None)) and not is_foreign(file)
    }
    bases = {base.__module__ for cls in classes for base in cls.__mro__}
    folders = {files[name].parent for name in bases if name in files}
    functions: dict[str, SourceFunction] = {}
    for module, path in files.items():
        if path.parent not in folders or path.suffix != ".py":
            continue
        text = path.read_text(encoding="utf-8")
        lines = dict(enumerate(text.splitlines(), 1))
        for name, node in _defined(ast.parse(text), module):
            own = range(node.lineno, (node.end_lineno or node.lineno) + 1)
            functions[name] = SourceFunction(
                str(path), node.lineno, "\n".join(lines[n] for n in own)
            )
            # The other lines keep their numbers.
            lines.update(dict.fromkeys(own, ""))
        functions[module] = SourceFunction(str(path), 1, "\n".join(lines.values()))
    return functions


def _defined(
    tree: ast.AST, prefix: str
) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """The functions of a module and its classes, without those within functions."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield f"{prefix}.{node.name}", node
        elif isinstance(node, ast.ClassDef):
            yield from _defined(node, f"{prefix}.{node.name}")


def main() -> int:
    """CauseAnswer the question of standard input.

    With a message on standard error, the exit code is 2 for bad input and 1 if users' code fails.
    """
    try:
        answer = answered(CauseQuestion(**json.load(sys.stdin)))
    except Exception as error:
        foreign = isinstance(error, MinervaError) and not isinstance(error, UserCodeError)
        sys.stderr.write(f"{error if foreign else report(error)}\n")
        return 2 if foreign else 1
    # What the code prints comes before it.
    sys.stdout.write(f"\n{json.dumps(asdict(answer))}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
