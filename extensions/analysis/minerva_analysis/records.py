"""Questions about records as functions, which `minerva explain` and `minerva diff` answer, too."""

from __future__ import annotations

from pathlib import Path

from minerva_analysis.causes import Explanation
from minerva_analysis.comparing import Difference, compare
from minerva_analysis.explaining import explain_running_value, explained_in
from minerva_bus.api.live import Live
from minerva_bus.api.world import World
from minerva_bus.arguments import path_of, text, whole_number
from minerva_bus.errors import MisuseError
from minerva_bus.log.record import Record


def diff(a: str | Path, b: str | Path) -> Difference:
    """The first frame in which two records differ, and why; `same` if none does.

    Raises RecordError.
    """
    with Record(path_of("a", a)) as first, Record(path_of("b", b)) as second:
        return compare(first, second)


def explain(
    source: str | Path | Live,
    agent: str,
    attribute: str,
    frame: int | None = None,
    world: World | str | Path = "",
) -> Explanation:
    """How an agent's attribute got its value: the methods, events and senders that led to it.

    The methods of the agents in question run again on the recorded events of a few frames. The
    latest frames of a running world are those of its journal, if it is on a bus, and earlier ones
    those of its record, as far as it is written; the world does not notice it.

    Args:
        source: a record, .mcap, or a running world.
        agent: id of the agent, with or without #.
        attribute: name of the attribute.
        frame: the value at the beginning of this frame is explained; None: the last one.
        world: the world with the agents' code; "": that of the running world, or the world file
            that the record names.

    Returns:
        The explanation: `links` lead from the change of the value back to its `origin`.

    Raises:
        RecordError: the record cannot be read, or has no such frame, agent or attribute.
        WorldFileError: the world file is missing.
        MinervaError: the record is of another world, or code of an agent fails.
        MisuseError: the running world has neither a journal nor a record on this machine.
        BusError: the running world does not answer.

    Example:
        `explain("run.mcap", "r1", "objective", frame=340).origin`

    """
    name = text("agent", agent).removeprefix("#")
    if frame is not None:
        frame = whole_number("frame", frame)
    attribute = text("attribute", attribute)
    if not attribute:
        raise MisuseError(f"explain #{name}: the attribute is empty; name one of the agent's")
    code = source.world if isinstance(source, Live) and world == "" else world
    reader = "" if code is None else code.read if isinstance(code, World) else str(code)
    if isinstance(source, Live):
        answer = explain_running_value(source.operator, reader, name, attribute, frame)
    else:
        with Record(path_of("record", source)) as record:
            answer = explained_in(record, reader, name, attribute, frame)
    assert isinstance(answer, Explanation)  # An attribute was asked for.
    return answer
