"""CPU time of 100 branches from frame 9,900 of a run with 10,000 frames, per frame.

    python benchmarks/branching.py            # traffic with 24 cars
    python benchmarks/branching.py --cars 8

The cost of a branch is that of its frames, if reading the record, the world file and the processes
of the study cost little. The unit is a frame of the recorded run, measured without a record.
"""

import argparse
import json
import resource
import tempfile
from pathlib import Path

from minerva_bus import branch, run


def cpu():
    """CPU seconds of this process and of its children that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def measured(function):
    began = cpu()
    result = function()
    return result, cpu() - began


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cars", type=int, default=24)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--branches", type=int, default=100)
    given = parser.parse_args()
    last, length = given.frames, given.frames // 100
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        options = {"cars": given.cars}
        plain, seconds = measured(lambda: run("traffic", frames=last, **options))
        done = run("traffic", frames=last, record=path, **options)
        table, branched = measured(
            lambda: branch(path, last - length, seeds=given.branches, quiet=True)
        )
    assert table["digest"][0] == done.digest == plain.digest
    frame, frames = seconds / last, given.branches * length
    print(
        json.dumps(
            {
                "frame_ms": round(1000 * frame, 3),
                "branch_frames": frames,
                "branch_seconds": round(branched, 2),
                "frames_paid": round(branched / frame),
                "ratio": round(branched / frame / frames, 3),
            }
        )
    )


if __name__ == "__main__":
    main()
