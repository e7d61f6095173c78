"""Histories in batches, and their results, which processes send each other."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

from tests.simulator.trying import tried_seed
from tests.simulator.writing import written


@dataclass(frozen=True, slots=True)
class Results:
    """Histories of consecutive seeds, played by one state of the code.

    `code` is a checksum of the project and the simulator, `revision` that of git. `failures` are
    lines of failed.jsonl.
    """

    revision: str
    code: str
    first: int
    histories: int = 0
    frames: int = 0
    cpu_seconds: float = 0.0
    failures: list[str] = field(default_factory=list[str])

    def with_batch(self, batch: Results) -> Results:
        """These results and those of the seeds that follow."""
        return replace(
            self,
            histories=self.histories + batch.histories,
            frames=self.frames + batch.frames,
            cpu_seconds=round(self.cpu_seconds + batch.cpu_seconds, 3),
            failures=self.failures + batch.failures,
        )

    @property
    def rate(self) -> float:
        """Histories per second of a processor."""
        return self.histories / self.cpu_seconds if self.cpu_seconds else 0.0

    def __str__(self) -> str:
        seeds = f"seeds {self.first} to {self.first + self.histories - 1}, revision {self.revision}"
        work = f"{self.histories} histories, {self.frames} frames in {self.cpu_seconds:.0f} CPU s"
        return f"{work} ({self.rate:.1f} histories per CPU second); {seeds}"


def played(seeds: range) -> Results:
    """The results of these histories."""
    began, frames, failures = time.process_time(), 0, list[str]()
    for seed in seeds:
        again = tried_seed(seed)
        frames += again.frames
        if again.wrong:
            failures.append(written(again.history, f"seed {seed}: {'; '.join(again.wrong[:3])}"))
    seconds = time.process_time() - began
    return Results("", "", seeds.start, len(seeds), frames, seconds, failures)
