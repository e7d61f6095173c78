"""`minerva run`."""

from __future__ import annotations

import signal
import sys

import typer

from minerva_bus.cli.options import RunOptions
from minerva_bus.cli.output import FAILED, INTERRUPTED, WRONG, print_json, print_result
from minerva_bus.errors import MinervaError, MisuseError, WorldStopped
from minerva_bus.launch.child_processes import end_signals
from minerva_bus.launch.console import Console, RunSummary
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.process_table import NOTHING, Profiling
from minerva_bus.launch.supervisor import Supervisor
from minerva_bus.launch.world_files import WorldFile, read_world_file
from minerva_bus.settings.world_settings import BusSettings, Overrides


def read_world(world: str, overrides: Overrides) -> WorldFile:
    """Read the world file of a path or an installed name. Raises WorldFileError and SceneError."""
    return read_world_file(find_world(world), overrides)


def run_world(file: WorldFile, began: float, options: RunOptions) -> None:
    """Run a world and print its summary; exits with 1 if it failed and with 130 on Ctrl-C.

    `began` is when the program started, on the monotonic clock, seconds.
    """
    profiling = Profiling(options.profile, options.profile_member)
    if options.in_process and profiling != NOTHING:
        raise MisuseError("--profile and --profile-member measure the bus: omit --in-process")
    as_json = file.watch.log_format == "json"
    quiet = options.quiet or (options.json and not as_json and not sys.stderr.isatty())
    console = Console(quiet=quiet, json=as_json, world=file.world.name, traceback=options.traceback)
    failure = ""
    try:
        if options.in_process:
            default, names = BusSettings(), ("connect", "journal", "listen")
            if unused := [n for n in names if getattr(file.bus, n) != getattr(default, n)]:
                console.note(f"{file.world.name}: no effect without a bus: {', '.join(unused)}")
            summary, failure = _run_here(file, console, began, as_json=as_json or options.json)
        else:
            profiling.check(file)
            supervisor = Supervisor(file, console, began, profiling)
            summary = supervisor.run()
            failure = supervisor.failure
    except MinervaError as error:
        # Someone who reads JSON lines finds every error among them; otherwise `main` prints it.
        if not as_json:
            raise
        console.problem(str(error))
        raise typer.Exit(WRONG) from None
    _print_summary(summary, console, options, file.record.path, as_json=as_json or options.json)
    if summary.ended in ("interrupted", "terminated"):
        raise typer.Exit(INTERRUPTED)
    if failure or summary.incomplete:
        raise typer.Exit(FAILED)


def _run_here(
    file: WorldFile, console: Console, began: float, *, as_json: bool
) -> tuple[RunSummary, str]:
    """Run a world in this process; returns its summary and the error that has ended it, or ""."""
    from minerva_bus.launch.in_process import InProcessRun

    for number in end_signals():
        # Every signal that ends a process becomes KeyboardInterrupt, so the run closes its record.
        signal.signal(number, signal.default_int_handler)
    run = InProcessRun(file, console, began, alone=True)
    try:
        summary = run.run()
    except WorldStopped as stopped:
        hint = "" if console.traceback else " (--traceback shows all frames)"
        console.problem(stopped.rest + hint if stopped.rest else str(stopped))
        if not as_json:  # The error has said in which frame and why.
            raise typer.Exit(FAILED) from None
        return run.summary(), str(stopped)
    return summary, summary.ended if run.failed else ""


def _print_summary(
    summary: RunSummary, console: Console, options: RunOptions, record: str, *, as_json: bool
) -> None:
    """Print a summary; without the coordinator's part, as text only the cause of the end."""
    if not summary.digest:
        console.problem(summary.ended)
    if as_json:
        print_json(summary.plain())
    elif summary.digest and not options.quiet:
        print_result("\n".join(summary.lines()))
        if record and not any(each.startswith("record: ") for each in summary.incomplete):
            print_result(f"  record: {record}")
