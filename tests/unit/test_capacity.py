"""The resources for a world are checked before any process starts."""

import pytest

from minerva_bus.launch.capacity import (
    BASE_FILES,
    BYTES_PER_PROCESS,
    THREADS_PER_PROCESS,
    Headroom,
    cores,
    shortage,
)


def test_without_limits_everything_fits():
    assert shortage(1000, Headroom()) == ""


@pytest.mark.parametrize(("name", "enough", "said"), [
    ("files", 500 + BASE_FILES, "open files in one process"),
    ("threads", 500 * THREADS_PER_PROCESS, "threads"),
    ("bytes", 500 * BYTES_PER_PROCESS, "MiB of memory"),
])  # fmt: skip
def test_the_scarce_resource_is_named(name, enough, said):
    assert shortage(500, Headroom(**{name: enough})) == ""
    assert said in shortage(500, Headroom(**{name: enough - 1}))


def test_there_is_a_core():
    assert cores() >= 1
