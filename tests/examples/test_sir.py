"""docs/migration/1-mesa.md: both programs run, and their epidemics are comparable."""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from extensions.study.benchmarks.sir import FRAMES, curves_of, plotted

# Not importorskip: other processes import Mesa, and the import takes 1 s in each test worker.
pytestmark = pytest.mark.skipif(find_spec("mesa") is None, reason="the extra docs installs Mesa")
ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "sir"
PAGE = (ROOT / "docs" / "migration" / "1-mesa.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, re.M | re.S)


def test_the_page_shows_the_programs():
    assert BLOCKS[0] == (FOLDER / "sir.py").read_text(encoding="utf-8")
    assert BLOCKS[1] == (FOLDER / "sir_mesa.py").read_text(encoding="utf-8")


def test_the_last_block_runs_both_programs():
    done = subprocess.run(
        [sys.executable, "-c", BLOCKS[2]], cwd=FOLDER, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    peaks = [int(number) for number in done.stdout.split()]
    assert len(peaks) == 2
    assert all(3 < peak < 200 for peak in peaks)


def test_epidemics_agree_within_their_spread(tmp_path):
    curves = curves_of(5)
    for runs in curves.values():
        assert runs.shape == (5, 2, FRAMES + 1)
        assert (runs[:, 0, 0] == 3).all()
        assert (np.diff(runs[:, 1]) >= 0).all()  # The immune remain so.
    for number in (0, 1):
        ours, mesa = (runs[:, number].max(axis=1) for runs in curves.values())
        error = np.hypot(ours.std(), mesa.std()) / 5**0.5
        assert abs(ours.mean() - mesa.mean()) < 4 * error
    plotted(tmp_path / "sir.png", curves)
    assert (tmp_path / "sir.png").stat().st_size > 10_000
