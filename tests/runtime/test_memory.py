"""Arrays of a frame are in memory that the frame before has freed."""

import resource

import numpy as np
import pytest

from minerva_bus.runtime.runner import keep_freed_memory

ARRAY_BYTES = 4_000_000  # numpy treats arrays from 4 MiB on in a way of its own
ARRAYS = 6


def faults_of_a_frame() -> int:
    """Pages that the system provides while arrays are written and freed."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    arrays = [np.ones(ARRAY_BYTES, np.uint8) for _ in range(ARRAYS)]
    del arrays
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def test_arrays_of_a_frame_reuse_those_of_the_frame_before():
    if not keep_freed_memory():
        pytest.skip("another C library, or variables that choose otherwise")
    faults_of_a_frame()
    pages = ARRAYS * ARRAY_BYTES // resource.getpagesize()
    assert min(faults_of_a_frame() for _ in range(5)) < pages / 10


@pytest.mark.parametrize("name", ["MALLOC_TRIM_THRESHOLD_", "GLIBC_TUNABLES"])
def test_the_users_own_choice_stays(monkeypatch, name):
    monkeypatch.setenv(name, "1")
    assert not keep_freed_memory.__wrapped__()
