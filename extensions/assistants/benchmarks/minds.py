"""Time of a frame with slow participants, and without: their answers must not hold it up.

    python -m extensions.assistants.benchmarks.minds
        [--participants 100] [--frames 900] [--rate 30] [--rounds 3] [--json]

Each participant lives in every frame; with requests, it asks a mind again as soon as it has an
answer, which takes 0.2 to 20 seconds, evenly distributed on a logarithmic scale. All processes run
on a bus. `p99_with` and `p99_without` are the 99th percentiles of the time between the beginnings
of two frames in milliseconds, `p50_with` and `p50_without` the medians: each the median of rounds
that alternate. `answers` is the number of answers in all rounds. The times depend on the load of
the machine; compare the two.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import statistics
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import Table, options
from minerva_assistants.llm.backends import Prompt
from minerva_assistants.minds import MINDS, eAsk
from minerva_bus import Agent, EventType, Vocabulary, on
from minerva_bus.log.record import Record

LEAST, MOST = 0.2, 20.0  # seconds
WARM_UP = 30  # frames
PERCENTILES = (50, 99)
COLUMNS = {"ms": "<10", "with": ">8.2f", "without": ">8.2f", "ratio": ">6.2f"}

eStep = EventType("eStep")
eThought = EventType("eThought", text=str)


class Participant(Agent, symbol="AParticipant"):
    """Lives in each frame, and asks again after each answer if it `asks`."""

    asks: bool = True
    waits: bool = False
    lived: int = 0
    answers: int = 0

    @on("eStep")
    def live(self, step, moment):
        self.lived += 1
        if self.asks and not self.waits:
            self.waits = True
            prompt = f"{self.id} after {self.answers} answers"
            moment.emit(eAsk(prompt, "", "eThought", "", 1e6, receivers=["mind"]))

    @on("eThought")
    def learn(self, thought, moment):
        self.waits = False
        self.answers += 1


vocabulary = Vocabulary.of(*MINDS, eStep, eThought, Participant)


async def answer(prompt: Prompt) -> dict[str, str]:
    """An answer after a time that depends on the prompt."""
    text = prompt.turns[0][1]
    share = int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest()) / 2**32
    await asyncio.sleep(LEAST * (MOST / LEAST) ** share)
    return {"text": text}


WORLD = """
[world]
string = "{string}"
vocabulary = "extensions.assistants.benchmarks.minds:vocabulary"
rate = {rate}
frames = {frames}

[process.minds]
agents = "mind"

[process.participants]
agents = "extensions.assistants.benchmarks.minds:Participant"

[process.steps]
service = "each"
event = "eStep"

[process.llm]
service = "llm"
backend = "extensions.assistants.benchmarks.minds:answer"
concurrent = {participants}
"""


def measured(given: Any, asks: bool) -> tuple[dict[str, float], int]:
    """Percentiles of the time between two frames in ms, and the number of answers, of one run."""
    agents = [f"AParticipant#p{n}<asks={str(asks).lower()}>" for n in range(given.participants)]
    string = " · ".join(["AMind#mind", *agents])
    settings = {"rate": given.rate, "frames": given.frames, "participants": given.participants}
    with tempfile.TemporaryDirectory() as folder:
        path, record = Path(folder) / "minds.toml", Path(folder) / "minds.mcap"
        path.write_text(WORLD.format(string=string, **settings))
        run = [sys.executable, "-m", "minerva_bus", "run", str(path), "--record", str(record)]
        done = subprocess.run([*run, "--json"], capture_output=True, text=True, check=True)
        with Record(record) as read:
            times = [timing["seconds"] for timing in read.timings()]
    between = [later - earlier for earlier, later in pairwise(times[WARM_UP:])]
    percentiles = {f"p{n}": float(np.percentile(between, n)) * 1e3 for n in PERCENTILES}
    return percentiles, json.loads(done.stdout).get("answered", 0)


def main() -> None:
    """Run the benchmark."""
    given = options(__doc__, participants=100, frames=900, rate=30, rounds=3)
    runs = [(asks, *measured(given, asks)) for _ in range(given.rounds) for asks in (True, False)]
    table = Table(COLUMNS, as_json=False) if not given.json else None
    row: dict[str, float] = {}
    for name in (f"p{n}" for n in PERCENTILES):
        pair = [
            statistics.median(times[name] for asked, times, _ in runs if asked is asks)
            for asks in (True, False)
        ]
        row |= {f"{name}_with": round(pair[0], 3), f"{name}_without": round(pair[1], 3)}
        if table is not None:
            table.row({}, name, *pair, pair[0] / pair[1])
    row["answers"] = sum(answers for _, _, answers in runs)
    print(json.dumps(row) if given.json else f"{row['answers']:.0f} answers")


if __name__ == "__main__":
    main()
