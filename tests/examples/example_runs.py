"""Shared helpers for the tests of examples: in-process runs and README code blocks."""

from __future__ import annotations

import re
from pathlib import Path

from minerva_bus import Event, Scene
from minerva_bus.frame.stimuli import FrameDone
from minerva_bus.grammar.events import single
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from tests.one_process import run_file

EXAMPLES = Path(__file__).resolve().parents[2] / "worlds" / "minerva_worlds"


class Run:
    """A complete in-process run of a world file: strings, digests and events by frame."""

    def __init__(
        self,
        world: Path,
        frames: int = 0,
        *settings: str,
        compiled: bool | None = None,
        **options: str,
    ) -> None:
        overrides = Overrides(
            frames=frames or None, settings=settings, options=options, compiled=compiled
        )
        file = read_world_file(world, overrides)
        self.scenes: list[Scene] = []
        self.digests: list[str] = []
        self.events: list[list[Event]] = []

        def watch(done: FrameDone, scene: Scene) -> None:
            self.scenes.append(scene)
            self.digests.append(scene.digest.hex())
            self.events.append(list(single(done.record.events)))

        run_file(file, watch=watch)


def blocks(readme: Path, language: str) -> list[str]:
    """The code blocks of a README in one language."""
    return re.findall(rf"```{language}\n(.*?)```", readme.read_text(encoding="utf-8"), re.DOTALL)
