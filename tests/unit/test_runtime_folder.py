"""Running worlds: the folder that lists them, and their state as operators see it."""

import fcntl
import json
import os
import threading
from dataclasses import replace

import pytest

from minerva_bus.errors import BusError
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.registry import (
    WorldLock,
    find,
    make_runtime_folder,
    running,
    runtime_folder,
)
from minerva_bus.runtime.coordinator import Coordinator, Watchers
from minerva_bus.runtime.questions import status_of


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The folder with its default name in a shared temporary folder."""
    monkeypatch.delenv("MINERVA_RUNTIME_DIR", raising=False)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert runtime_folder().parent == tmp_path
    return runtime_folder()


def refused(problem):
    """Check that neither starting a world nor listing worlds uses the folder."""
    for use in (make_runtime_folder, lambda: WorldLock("w"), running):
        with pytest.raises(BusError, match=f"{problem}.*MINERVA_RUNTIME_DIR"):
            use()


def test_it_is_made_for_its_user_alone(place):
    assert running() == []
    assert make_runtime_folder() == place
    assert place.stat().st_mode & 0o777 == 0o700


def test_a_folder_of_another_user_is_refused(place, monkeypatch):
    place.mkdir(mode=0o700)
    before = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: before + 1)
    monkeypatch.setattr("minerva_bus.launch.registry.runtime_folder", lambda: place)
    monkeypatch.setattr("minerva_bus.launch.registry.runtime_folder", lambda: place)
    refused("belongs to another user")


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_folder_that_others_can_write_to_is_refused(place, mode):
    place.mkdir()
    place.chmod(mode)
    refused("is writable by others")


def test_a_link_in_place_of_the_folder_is_refused(place, tmp_path):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    place.symlink_to(tmp_path / "elsewhere")
    refused("is a symbolic link")
    assert not any((tmp_path / "elsewhere").iterdir())


def test_a_file_in_place_of_the_folder_is_refused(place):
    place.write_text("")
    with pytest.raises(BusError, match="MINERVA_RUNTIME_DIR"):
        make_runtime_folder()
    with pytest.raises(BusError, match="is not a folder"):
        running()


def test_a_link_in_the_folder_is_not_written_through(place, tmp_path):
    valuable = tmp_path / "valuable.json"
    valuable.write_text(json.dumps({"world": "w", "endpoint": "tcp/attacker:1", "pid": 1}))
    before = valuable.read_text()
    make_runtime_folder()
    (place / "w.json").symlink_to(valuable)
    with pytest.raises(BusError, match=r"w\.json cannot be opened"):
        WorldLock("w")
    assert running() == []
    assert valuable.read_text() == before


def test_a_reader_finds_a_world_while_its_endpoint_changes(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    lock = WorldLock("w")
    endpoints = [f"tcp/127.0.0.1:{port}" for port in (7447, 80)]
    lock.publish(endpoints[0])
    done = threading.Event()

    def change():
        for number in range(2000):
            lock.publish(endpoints[number % 2])
        done.set()

    thread = threading.Thread(target=change)
    thread.start()
    worlds = []
    while not done.is_set():
        worlds += running()
        assert len(running()) == 1
    thread.join()
    lock.release()
    assert {world.endpoint for world in worlds} <= set(endpoints)
    assert running() == []


def test_a_world_starts_while_another_process_lists_the_worlds(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    lock_file, refusals = fcntl.flock, []
    with (tmp_path / "w.json").open("w") as probed:
        fcntl.flock(probed, fcntl.LOCK_SH)

        def flock(file, operation):
            try:
                lock_file(file, operation)
            except OSError:
                lock_file(probed, fcntl.LOCK_UN)
                refusals.append(operation)
                raise

        with monkeypatch.context() as patched:
            patched.setattr(fcntl, "flock", flock)
            lock = WorldLock("w")
    assert refusals == [fcntl.LOCK_EX | fcntl.LOCK_NB]
    with pytest.raises(BusError, match="a world 'w' runs here already"):
        WorldLock("w")
    lock.release()


def test_of_several_worlds_the_preferred_one_is_chosen(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    locks = [WorldLock("a")]
    locks[0].publish("tcp/127.0.0.1:1")
    assert find(preferred="b").world == "a"  # The file's world may run under another name.
    locks.append(WorldLock("b"))
    locks[1].publish("tcp/127.0.0.1:2")
    assert find(preferred="b").world == "b"
    assert find("a", preferred="b").world == "a"
    for preferred in ("", "c"):
        with pytest.raises(BusError, match="several worlds run on this machine"):
            find(preferred=preferred)
    for lock in locks:
        lock.release()


WORLD = WorldSpec("w", EMPTY, Vocabulary.of())


def ignore(*_):
    """Watch nothing."""


def waited(world, seconds):
    """The awaited members of a world, and the seconds of which its state speaks."""
    watchers = Watchers(said=ignore, status=ignore, listening=ignore, stalled=ignore)
    coordinator = Coordinator(world, watchers)
    coordinator.status.waited = seconds
    status = status_of(coordinator)
    return status.waiting, status.waited


def test_a_world_that_waits_for_nobody_has_not_waited():
    """The waiting time is measured at intervals, and who is awaited is known at once."""
    assert waited(WORLD, 3.8) == ((), 0.0)
    assert waited(replace(WORLD, expected=frozenset({"a"})), 3.8) == (("a",), 3.8)
