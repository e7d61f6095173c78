"""`minerva top`."""

from __future__ import annotations

import json
import sys
import time

from minerva_bus.cli.asking import listing
from minerva_bus.cli.places import client
from minerva_bus.cli.saying import say
from minerva_bus.errors import MinervaError

MEASURED_FOR = 0.5


def watch_world(connect: str, world: str, json_too: bool) -> None:
    """Monitor a world until q or Ctrl-C; as JSON, print its status once."""
    if not json_too:
        _check_terminal()
    with client(connect, world) as asked:
        if json_too:
            asked.operator.status()
            time.sleep(MEASURED_FOR)  # Measurement starts with the first request.
            say(json.dumps(listing(asked.operator.status())))
            return
        try:
            from minerva_bus.cli.top.dashboard import Dashboard
        except ImportError:
            raise MinervaError("top needs textual: pip install 'minerva-bus[top]'") from None
        Dashboard(asked.operator).run()


def _check_terminal() -> None:
    if not sys.stdout.isatty():
        raise MinervaError("top needs a terminal; --json prints one status anywhere")
