"""`minerva replay` and `minerva seek`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import typer

from minerva_bus.cli.places import client
from minerva_bus.cli.running import show_run
from minerva_bus.launch.console import Console
from minerva_bus.launch.replaying import read_replay, recomputed
from minerva_bus.launch.supervisor import Supervisor
from minerva_bus.launch.worldfile import Overrides


def _print(line: str) -> None:
    print(line, flush=True)  # noqa: T201
