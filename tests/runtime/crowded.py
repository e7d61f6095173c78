"""Members that start in large numbers, each with some work to do before it joins."""

import os
import time
from pathlib import Path

from minerva_bus import Generator, Primitive, Vocabulary

vocabulary = Vocabulary.of(Primitive("PNothing"))


class Busy(Generator):
    """Records the begin and end of its start, and computes in between."""

    by_agent = True

    def __init__(self, seconds=0.0):
        folder = Path(os.environ.get("MINERVA_RUNTIME_DIR", ".")).parent / "starts"
        began = time.monotonic()
        until = time.process_time() + seconds
        while time.process_time() < until:
            pass
        folder.mkdir(exist_ok=True)
        with (folder / str(os.getpid())).open("a") as file:
            file.write(f"{began} {time.monotonic()}\n")
