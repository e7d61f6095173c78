"""The tests of `helics_cases`, in a process that no test of FMUs shares.

The library of HELICS exports the symbols of a C++ standard library of its own, and FMUs that are
loaded after it crash.
"""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

CASES = Path(__file__).with_name("helics_cases.py")


@pytest.mark.skipif(not find_spec("helics"), reason="needs HELICS (pip install helics)")
def test_a_world_is_a_federate_of_helics():
    words = [sys.executable, "-m", "pytest", "-q", str(CASES)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
