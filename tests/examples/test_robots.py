"""Four robots in one house: device owners, errands, and no collisions."""

import json
import os
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "worlds" / "minerva_worlds" / "robots"


def run(tmp_path, *options):
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", "run", "robots.toml", "--in-process", "--json", *options],
        cwd=FOLDER,
        env={**os.environ, "MINERVA_RUNTIME_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


def test_four_robots_drive_off_without_a_collision(tmp_path):
    said = run(tmp_path, "--frames", "60")
    assert said["frames"] == 60
    shown = json.dumps(said)
    assert '"collisions": 0' in shown
    assert said["digest"]
