"""The launcher that `api/on_bus.py` starts: `python -m minerva_bus.api.child CONFIG`."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from minerva_bus.collect.plans import read_expression
from minerva_bus.errors import MinervaError
from minerva_bus.frame import stimuli as s
from minerva_bus.launch.console import Console
from minerva_bus.launch.supervisor import Supervisor
from minerva_bus.launch.world_files import Collecting, WorldFile, read_world_file
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.runner import Notice
from minerva_bus.settings.world_settings import Overrides

KILL_SECONDS: Final = 5.0
"""Time for a launcher without a parent to end its world, before it is killed."""


def main() -> None:
    """Run the world of a configuration, and write its result to the file that it names."""
    from minerva_bus.api.running import write_result

    config: dict[str, Any] = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    _die_with_parent()
    # The caller's folders come first: classes must come from the modules that the caller has
    # imported.
    sys.path[:] = [*dict.fromkeys([*config["folders"], *sys.path])]
    end = Path(config["end"])
    try:
        file, create = _opened(config)
        last = end.with_name("last.json")
        console = Console(quiet=config["quiet"], world=file.world.name)

        def make(*given: Any, **settings: Any) -> Coordinator:
            coordinator = witnessed(last, create, *given, **settings)
            if config["paused"]:
                coordinator.schedule.pace.pause()
            return coordinator

        supervisor = Supervisor(file, console, time.monotonic(), coordinator=make)
        summary = supervisor.run()
        result: dict[str, Any] = {"scene": "", "events": {}}
        if last.exists():
            result = json.loads(last.read_text(encoding="utf-8"))
        write_result(
            end,
            {
                **result,
                "summary": summary.plain(),
                "figures": {
                    name: value
                    for name, value in sorted(summary.figures.items())
                    if isinstance(value, str | int | float)
                },
                "failure": supervisor.problem,
            },
        )
    except MinervaError as error:
        write_result(end, {"error": str(error)})
        print(f"minerva: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(1)


def _opened(config: dict[str, Any]) -> tuple[WorldFile, Callable[..., Coordinator]]:
    """The world of a configuration, and what makes its coordinator."""
    given, past = Overrides(config["given"]), config["past"]
    overrides = Overrides(
        config["options"], tuple(config["settings"]), tuple(config["views"]), **config["values"]
    )

    def read(settings: Overrides) -> WorldFile:
        return read_world_file(Path(config["world"]), settings.over(given))

    if past is None:
        file, create = read(overrides), Coordinator
    else:
        module, name, values = past
        file, create = getattr(import_module(module), name)(**values).read(read, overrides)
    entries = {
        name: read_expression(text, f"collect: {name}") for name, text in config["collect"].items()
    }
    return replace(file, collect=Collecting(entries, config["into"])), create


def witnessed(
    last: Path, create: Callable[..., Coordinator], *given: Any, **settings: Any
) -> Coordinator:
    """A coordinator that writes the last string and the counts of events to a file."""
    from minerva_bus.api.running import EventCounts, write_result

    counts = EventCounts()

    def stopping(notice: Notice) -> None:
        if isinstance(notice, s.Stopping):
            scene = str(coordinator.algorithm.scene)
            # A file, because the coordinator is another process than the launcher that writes the
            # result.
            write_result(last, {"scene": scene, "events": counts.sorted()})

    coordinator = create(*given, sinks=[counts, stopping], **settings)
    return coordinator


def _die_with_parent() -> None:
    """End the launcher when its parent dies, which closes standard input."""
    # A process watches, not a thread, because the launcher forks.
    launcher = os.getpid()
    if os.fork():
        return
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    while os.read(0, 4096):
        pass
    # If the launcher has ended by itself, its id may belong to another process by now.
    if os.getppid() == launcher:
        os.kill(launcher, signal.SIGTERM)
    # A launcher that is stopped or stuck ignores the signal; its children end with it.
    until = time.monotonic() + KILL_SECONDS
    while os.getppid() == launcher and time.monotonic() < until:
        time.sleep(0.05)
    if os.getppid() == launcher:
        os.kill(launcher, signal.SIGKILL)
    # Without the interpreter's clean-up: that is the launcher's, and this process is a copy of it.
    os._exit(0)


if __name__ == "__main__":
    main()
