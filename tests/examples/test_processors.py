"""Worlds give the same digests on any processor.

The tests disable the AVX-512, AVX2 and FMA code of numpy and the C library, and make OpenBLAS assume
an older processor.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

WORLDS = Path(__file__).with_name("processor_worlds.py")
NUMPY = "X86_V4 AVX512_ICL AVX512_SPR"
C_LIBRARY = "glibc.cpu.hwcaps=-AVX2,-AVX2_Usable,-FMA,-FMA_Usable,-FMA4,-AVX512F"
OLDER = {
    "AVX-512": {"NPY_DISABLE_CPU_FEATURES": NUMPY},
    "AVX2 and FMA": {
        "NPY_DISABLE_CPU_FEATURES": f"X86_V3 {NUMPY}",
        "GLIBC_TUNABLES": C_LIBRARY,
        "OPENBLAS_CORETYPE": "Nehalem",
    },
}
PROBE = """
import math, numpy as np
x = np.linspace(0.01, 9, 5000)
print(np.log(x).tobytes().hex(), [math.exp(one).hex() for one in x.tolist()])
"""


def run(*words, **environment):
    done = subprocess.run(
        [sys.executable, *words], env={**os.environ, **environment},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def as_it_is():
    return json.loads(run(WORLDS))


def assert_same(expected, computed):
    for world, frames in expected.items():
        differ = [n for n, line in enumerate(frames) if line != computed[world][n]]
        assert not differ, f"{world} differs first in frame {differ[0]} of {len(frames)}"


def test_worlds_do_not_depend_on_the_last_bits_of_the_libraries(as_it_is):
    assert_same(as_it_is, json.loads(run(WORLDS, "nudged")))


@pytest.mark.parametrize("off", OLDER)
def test_worlds_do_not_depend_on_the_processor(as_it_is, off):
    if run("-c", PROBE) == run("-c", PROBE, **OLDER[off]):
        pytest.skip(f"this processor or C library makes no difference: {off}, {np.__version__}")
    assert_same(as_it_is, json.loads(run(WORLDS, **OLDER[off])))
