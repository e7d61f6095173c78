"""Records as functions, which `minerva explain`, `diff` and `replay` call, too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from minerva_analysis.causes import Explanation
from minerva_analysis.comparing import Difference, compare
from minerva_analysis.explaining import explain_running_value, explained_in
from minerva_analysis.replays import CODE, ReplayedRecord, no_progress, recompute, world_file_of
from minerva_bus.api.live import Live
from minerva_bus.api.running import Run, run_request, world_of_record
from minerva_bus.api.world import World, request_of
from minerva_bus.errors import MisuseError
from minerva_bus.launch.past import kinds_in
from minerva_bus.launch.world_files import Collecting
from minerva_bus.log.record import Record
from minerva_bus.values import path_of, text, text_list, whole_number


def replay(
    record: str | Path,
    world: World | str | Path = "",
    progress: Callable[[int, int], None] | None = None,
) -> Difference:
    """Run the agents of a record again and compare each frame; `same` if all are equal.

    Args:
        record: the file, .mcap.
        world: the world with the agents' code; "": the world file that the record names.
        progress: called with the number of completed frames and the total.

    Raises RecordError, WorldFileError and MinervaError, also if the record is of another world.

    Example:
        `assert replay("run.mcap").same`

    """
    path, report = path_of("record", record), progress or no_progress
    source = world.read if isinstance(world, World) else str(world)
    with Record(path) as opened:
        file = world_file_of(path, source, opened.description, CODE)
        last = opened.last()[0]
        return recompute(opened, kinds_in(file), lambda done: report(done, last))


def replay_views(
    record: str | Path,
    views: str | Sequence[str],
    world: World | str | Path = "",
    *,
    begin: int = 0,
    speed: float = 1.0,
    quiet: bool = False,
) -> Run:
    """Show a record in views, also in those that did not take part in its run.

    The strings are those of the record; only the code of agents that draws them runs. The views
    run in processes of their own, so classes of agents must be in modules.

    Args:
        record: the file, .mcap.
        views: as for `minerva replay --view`: "sprites", "svg:path=run.svg,every=10",
            "module:Class", or several of them.
        world: the world with the agents' code; "": the world file that the record names.
        begin: the first frame.
        speed: 1: real time; 2: twice as fast; 0: as fast as possible.
        quiet: show errors only; otherwise log lines, such as the address of a page, go to
            standard error.

    Returns:
        The replayed run, with its last string. With a window or a page, it ends when the view is
        closed.

    Raises:
        RecordError: the record cannot be read.
        MisuseError: there is no such frame, or an argument is wrong.
        WorldFileError: there is no such view, or the world's file is missing.
        MinervaError: the record is of another world.
        Interrupted: a KeyboardInterrupt with the run so far, after Ctrl-C.

    Example:
        `replay_views("run.mcap", "svg:path=run.svg", speed=0)`

    """
    shown = (views,) if isinstance(views, str) else text_list("views", views)
    past = ReplayedRecord(str(record), begin, speed)
    request = request_of(world_of_record(record, world), {}, views=shown, past=past)
    # The record is replayed, not the collected data of its world file.
    request = replace(request, file=replace(request.file, collect=Collecting()))
    return run_request(request, bus=True, quiet=quiet)


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
