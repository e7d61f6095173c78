"""Whether a machine can carry a world is known before anything is started."""

import pytest

from minerva_bus.launch.capacity import (
    BYTES_EACH,
    FILES_BESIDE,
    THREADS_EACH,
    Bounds,
    cores,
    shortage,
)


def test_where_nothing_is_bounded_everything_fits():
    assert shortage(1000, Bounds()) == ""


@pytest.mark.parametrize(("name", "enough", "said"), [
    ("files", 500 + FILES_BESIDE, "open files in one process"),
    ("threads", 500 * THREADS_EACH, "threads"),
    ("bytes", 500 * BYTES_EACH, "MiB of memory"),
])  # fmt: skip
def test_what_is_short_is_named(name, enough, said):
    assert shortage(500, Bounds(**{name: enough})) == ""
    assert said in shortage(500, Bounds(**{name: enough - 1}))


def test_there_is_a_core():
    assert cores() >= 1
