"""The command line can be interrupted at any time, also during its imports."""

import subprocess
import sys

INTERRUPTED_IMPORT = """
import runpy
import sys

class Finder:
    def find_spec(self, name, *_):
        if name == "typer":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Finder())
sys.argv = ["minerva", "list"]
runpy.run_module("minerva_bus", run_name="__main__")
"""


def test_an_interrupt_while_modules_are_read_is_no_traceback():
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_IMPORT], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


WAITS_AND_BECOMES = """
import os, sys, time

time.sleep(2)
os.execv(sys.executable, [sys.executable, "-c", sys.argv[1], str(time.monotonic())])
"""
SAYS_ITS_AGE = """
import sys
from minerva_bus.process_life import BEGAN

print(float(sys.argv[1]) - BEGAN)
"""


def test_start_up_is_counted_from_the_program_and_not_from_the_shell_that_became_it():
    words = [sys.executable, "-c", WAITS_AND_BECOMES, SAYS_ITS_AGE]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 1  # the processor time of the shell, without its sleep
