"""`minerva metrics` and `minerva top`."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from minerva_bus.cli.options import Json, NamedTarget, examples, grouped

TOPIC: Final = "Observe"

MEASURE_SECONDS: Final = 0.5
"""Time for `top --json` to measure, which begins with the first query."""


@examples(
    "minerva metrics",
    "minerva metrics robot --listen 0.0.0.0:9464",
)
@grouped
def metrics(
    listen: Annotated[str, typer.Option(help="Serve at HOST:PORT.")] = "127.0.0.1:9464",
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Serve /metrics, /live and /ready of a running world.

    The server is a separate process, until Ctrl-C; a world that ends is reported as down.
    """
    import signal
    import threading

    from minerva_bus.cli.output import Done, print_report
    from minerva_bus.cli.places import client
    from minerva_bus.launch.child_processes import end_signals
    from minerva_monitoring.metrics_server import Exporter

    stop = threading.Event()

    def end(*_: object) -> None:
        stop.set()

    with client(target) as world, Exporter(world.world, listen, world.ask) as exporter:
        for number in end_signals():
            signal.signal(number, end)
        text = f"{world.world}: metrics at {exporter.url}"
        print_report(Done(text, {"world": world.world, "url": exporter.url}), json)
        stop.wait()


@examples(
    "minerva top",
    "minerva top robot --json",
)
@grouped
def top(
    json: Annotated[bool, typer.Option("--json", help="Print the status once, as JSON.")] = False,
    *,
    target: NamedTarget,
) -> None:
    """Monitor and control a running world in the terminal."""
    import sys
    import time

    from minerva_bus.cli.list_and_echo import listing
    from minerva_bus.cli.output import print_json
    from minerva_bus.cli.places import client
    from minerva_bus.errors import MinervaError
    from minerva_bus.wording import install

    if not json and not sys.stdout.isatty():
        raise MinervaError("top needs a terminal; --json prints one status anywhere")
    with client(target) as world:
        if json:
            world.operator.status()
            time.sleep(MEASURE_SECONDS)
            print_json(listing(world.operator.status()))
            return
        try:
            from minerva_monitoring.top_dashboard import Dashboard
        except ImportError:
            raise MinervaError(f"top needs textual: {install('top')}") from None
        Dashboard(world.operator).run()
