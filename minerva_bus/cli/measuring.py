"""`minerva metrics`."""

from __future__ import annotations

import signal
import threading
from types import FrameType

from minerva_bus.cli.places import client
from minerva_bus.cli.saying import tell
from minerva_bus.launch.exporting import Exporter
from minerva_bus.launch.interrupts import end_signals


def serve_metrics(listen: str, connect: str, world: str) -> None:
    """Serve the metrics of a world until Ctrl-C; a world that ends is reported as down."""
    stop = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        stop.set()

    with client(connect, world) as asked, Exporter(asked.world, listen, asked.ask) as exporter:
        for number in end_signals():
            signal.signal(number, end)
        tell(f"{asked.world}: metrics at {exporter.url}")
        stop.wait()
