"""A world under random faults for some minutes gives the same string as without faults.

    python -m checks.chaos [--minutes 10] [--seed 1] [--rate 20] [--folder FOLDER]

Eight processes run 200 ants (checks/colony.py), which are born and die. At random times,
members and the coordinator are killed (SIGKILL) or frozen for a while (SIGSTOP, SIGCONT); external
hosts join, some of them through a proxy that delays the traffic, and leave, are killed or drained;
the world is paused. Meanwhile another client repeats messages of members and the coordinator with a
delay. At the end the string must have the digest of an undisturbed run, and the two records must
have the same events in every frame. Whenever the world waits for long, it must say for whom, and
what follows. The exit code is 0 if so, otherwise 1.

The seed determines the faults and their order; their exact times depend on the machine.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

from checks.chaos_faults import Chaos


def undisturbed(chaos: Chaos, frames: int) -> dict[str, object]:
    """The summary of a recorded run of `frames` frames in one process."""
    done = chaos.command(
        "run", chaos.world, "--in-process", "--frames", frames,
        "--record", chaos.folder / "undisturbed.mcap", "--json",
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"chaos: the undisturbed run failed ({done.returncode}):\n{done.stderr}")
    return json.loads(done.stdout)


def same_events(chaos: Chaos) -> str:
    """Differences between the two records, or an empty string."""
    done = chaos.command("diff", chaos.folder / "undisturbed.mcap", chaos.folder / "chaos.mcap")
    if done.returncode == 0:
        return ""
    # A killed `diff` prints nothing, and must not count as equal.
    return done.stdout + done.stderr or f"minerva diff ended with exit code {done.returncode}"


def run(folder: Path, given: argparse.Namespace) -> bool:
    minutes, seed = given.minutes, given.seed
    chaos = Chaos(folder, seed, given.rate)
    try:
        chaos.start()
        end = time.monotonic() + 60.0 * minutes
        while time.monotonic() < end:
            chaos.disturb()
            if chaos.launcher.poll() is not None:
                print(f"chaos: the world has ended; see {folder}/run.log")
                return False
        result = chaos.end()
        repeated = chaos.repeater.sent
    except SystemExit:
        chaos.print_last_lines()
        raise
    finally:
        chaos.close()
    frames = int(str(result["frames"]))
    alone = undisturbed(chaos, frames)
    differ = same_events(chaos)
    faults = ", ".join(f"{name} {count}" for name, count in sorted(chaos.done.items()))
    print(f"seed {seed}: {frames} frames, {faults}; {repeated} messages repeated")
    same = result["digest"] == alone["digest"]
    print(f"digest {result['digest']} {'=' if same else 'IS NOT'} {alone['digest']}")
    print(differ or "the same events in every frame")
    for wait in chaos.unsaid:
        print(f"waits without saying for whom, or what follows: {wait}")
    return same and not differ and not chaos.unsaid


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, default=20.0)
    parser.add_argument("--folder", type=Path, help="where logs and records stay")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        raise SystemExit(not run(folder, given))


if __name__ == "__main__":
    main()
