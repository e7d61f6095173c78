"""Steps end early if their caller asks; killed programs leave no folders."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from frogs import pond

from minerva_bus.launch.registry import temporary_folder


def test_a_step_ends_early_if_stop_is_true():
    with pond().start(seed=3) as live:
        assert live.step(10, lambda: live.frame == 4) == 4
        assert live.step(2) == 6


def test_the_folder_of_a_killed_program_is_removed_by_the_next_one(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    code = (
        "from minerva_bus.launch.registry import temporary_folder as made\n"
        "with made('live') as folder:\n"
        "    (folder / 'file').touch()\n"
        "    print(folder, flush=True)\n"
        "    input()\n"
    )
    running = subprocess.Popen(
        [sys.executable, "-c", code], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )  # fmt: skip
    assert running.stdout is not None
    theirs = Path(running.stdout.readline().strip())
    with temporary_folder("run") as own:
        assert own.parent == theirs.parent == tmp_path
        assert (theirs / "file").exists()
    assert not own.exists()
    running.send_signal(signal.SIGKILL)
    running.wait()
    (tmp_path / "minerva-other-folder").mkdir()
    with temporary_folder("run"):
        assert not theirs.exists()
        assert (tmp_path / "minerva-other-folder").exists()
