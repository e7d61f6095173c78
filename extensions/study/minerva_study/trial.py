"""One run of a world for a study: over the bus, as with `minerva run`, or in this process."""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from minerva_bus.api.child import witnessed
from minerva_bus.api.running import EventCounts
from minerva_bus.errors import WorldFileError, WorldStopped
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.console import Console, RunSummary
from minerva_bus.launch.in_process import InProcessRun, never
from minerva_bus.launch.supervisor import Supervisor
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.settings.world_settings import WatchSettings
from minerva_bus.user_code import report
from minerva_study.outcome import Outcome

LOCAL = "tcp/127.0.0.1:0"
_VARIABLE = "MINERVA_RUNTIME_DIR"


def prepared(file: WorldFile) -> WorldFile:
    """The world for a run as fast as possible beside others, without restarts.

    Raises WorldFileError for a world without an end, or with processes on other machines.
    """
    remote = [process.name for process in file.processes if process.elsewhere]
    if remote:
        raise WorldFileError(
            f"{file.path}: {remote[0]} runs elsewhere; a study needs all processes on this machine"
        )
    if not file.world.frames and not file.world.until:
        raise WorldFileError(f"{file.path}: the world has no end; --frames N sets one")
    # Runs at the same time must not share an endpoint, a record or an address for metrics. A
    # process that fails is not restarted, so the failure is that of the run.
    return replace(
        file,
        rate=0.0,
        processes=tuple([replace(process, restarts=0) for process in file.processes]),
        bus=replace(file.bus, listen=LOCAL),
        record=replace(file.record, path=""),
        watch=WatchSettings(),
    )


def run_trial(
    file: WorldFile, in_process: bool, interrupted: Callable[[], bool] = never
) -> Outcome:
    """Run a prepared world to its end. Raises MinervaError if it fails.

    A world in this process ends early if `interrupted` is true between two frames.
    """
    return _in_process(file, interrupted) if in_process else _over_the_bus(file)


def _over_the_bus(file: WorldFile) -> Outcome:
    with tempfile.TemporaryDirectory(prefix="world-") as folder:
        end = Path(folder) / "end"
        make = partial(witnessed, end, Coordinator)
        # A runtime folder of its own, because parallel runs have the same world name.
        with _runtime_folder(folder):
            supervisor = Supervisor(file, Console(quiet=True), time.monotonic(), coordinator=make)
            summary = supervisor.run()
        if supervisor.failure:
            raise WorldStopped(supervisor.failure)
        report = json.loads(end.read_text(encoding="utf-8"))
    scene = file.world.vocabulary.read(report["scene"], f"{file.path}: the final string")
    return _outcome(scene, summary, report["events"])


@contextmanager
def _runtime_folder(folder: str) -> Generator[None]:
    before = os.environ.get(_VARIABLE)
    os.environ[_VARIABLE] = folder
    try:
        yield
    finally:
        del os.environ[_VARIABLE]
        if before is not None:
            os.environ[_VARIABLE] = before


def _in_process(file: WorldFile, interrupted: Callable[[], bool]) -> Outcome:
    counts = EventCounts()
    run = InProcessRun(file, Console(quiet=True, traceback=True), time.monotonic(), counts)
    try:
        run.open()
        run.advance(interrupted=interrupted)
    except WorldStopped as error:
        raise WorldStopped(_explained(error)) from error
    finally:
        run.close()
    summary = run.summary()
    if run.failed:
        raise WorldStopped(summary.ended)
    return _outcome(run.algorithm.scene, summary, counts.sorted())


def _explained(stopped: WorldStopped) -> str:
    """Why a world stopped, with the line of code."""
    head = str(stopped).removesuffix("; the world stops")
    cause = stopped.__cause__
    return head if cause is None else "\n".join([head, *report(cause).split("\n")[1:]])


def _outcome(scene: Scene, summary: RunSummary, events: dict[str, int]) -> Outcome:
    return Outcome(
        scene=scene,
        frames=summary.frames,
        digest=summary.digest,
        ended=summary.ended,
        reached=summary.reached,
        events=events,
        figures=dict(sorted(summary.figures.items())),
    )
