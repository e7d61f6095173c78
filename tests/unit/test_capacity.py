"""The resources for a world are checked before any process starts."""

import resource

import pytest

from minerva_bus.errors import MisuseError
from minerva_bus.launch.capacity import (
    BASE_FILES,
    BYTES_PER_PROCESS,
    FILES_PER_PROCESS,
    THREADS_PER_PROCESS,
    Headroom,
    check_capacity,
    cores,
    shortage,
)


def test_without_limits_everything_fits():
    assert shortage(1000, Headroom()) == ""


@pytest.mark.parametrize(("name", "enough", "said"), [
    ("files", 500 * FILES_PER_PROCESS + BASE_FILES, "open files in one process"),
    ("threads", 500 * THREADS_PER_PROCESS, "threads"),
    ("bytes", 500 * BYTES_PER_PROCESS, "MiB of memory"),
])  # fmt: skip
def test_the_scarce_resource_is_named(name, enough, said):
    assert shortage(500, Headroom(**{name: enough})) == ""
    assert said in shortage(500, Headroom(**{name: enough - 1}))


def test_a_few_processes_need_open_files_too(monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda _: (20, 20))
    with pytest.raises(MisuseError, match=r"6 processes cannot start here: .* 20 are allowed"):
        check_capacity(6)
    # The soft limit is raised as far as the hard limit allows.
    raised = []
    monkeypatch.setattr(resource, "getrlimit", lambda _: (20, 40))
    monkeypatch.setattr(resource, "setrlimit", lambda _, limits: raised.append(limits))
    check_capacity(6)
    assert raised == [(40, 40)]


def test_there_is_a_core():
    assert cores() >= 1
