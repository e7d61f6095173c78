"""A command ends although code of the world has started a thread that does not."""

import subprocess
import sys

import pytest

LEAVING = """
import sys, threading, time
from minerva_bus.process_life import limit_threads

threading.Thread(target=time.sleep, args=({seconds},), name="sleeper", daemon={daemon}).start()
print("over")
limit_threads(3, said={said}, most={said})
sys.exit(3)
"""


@pytest.mark.parametrize(
    ("seconds", "daemon", "said", "named"),
    [(1000, False, 0.1, True), (1000, True, 0.1, False), (0.1, False, 60.0, False)],
)
def test_a_thread_that_does_not_end_is_named_and_ended(seconds, daemon, said, named):
    text = LEAVING.format(seconds=seconds, daemon=daemon, said=said)
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (3, "over\n")
    assert ("waiting for the thread 'sleeper'" in done.stderr) is named
    assert "Traceback" not in done.stderr


def test_threads_of_an_executor_end_by_themselves():
    text = """
from concurrent.futures import ThreadPoolExecutor
from minerva_bus.process_life import limit_threads

pool = ThreadPoolExecutor(2)
pool.submit(print, "done").result()
limit_threads(3, said=60.0)
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


def test_a_command_ends_with_its_exit_code(tmp_path):
    (tmp_path / "pl.py").write_text(
        "import threading\nthreading.Thread(target=threading.Event().wait).start()\n"
    )
    path = tmp_path / "w.toml"
    path.write_text('[world]\nstring = ""\nvocabulary = "pl:missing"\n')
    command = [sys.executable, "-m", "minerva_bus.cli.main", "check", str(path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "pl has no missing" in done.stdout + done.stderr
    assert "minerva: waiting for the thread 'Thread-1 (wait)'" in done.stderr
