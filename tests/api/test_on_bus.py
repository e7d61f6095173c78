"""Worlds in separate processes, started from Python."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from frogs import Frog, eCroak, eFeed, marsh, pond

from minerva_bus import Interrupted, connect, count, data, run
from minerva_bus.errors import BusError, MinervaError, MisuseError, WorldStopped
from minerva_bus.launch.registry import running
from minerva_bus.user_code import report
from tests.patience import eventually

COLLECT = {"frogs": count(Frog), "x": Frog.x, "croak": data(eCroak), "mood": Frog.mood}


@pytest.fixture(autouse=True)
def own_runtime_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "runtime"))


def config_of(live):
    """The configuration file that is an argument of all processes of a live world."""
    return live._backend._launched._config


def processes_of(config):
    lines = subprocess.run(["ps", "-Awwo", "args"], capture_output=True, text=True, check=True)
    return [line for line in lines.stdout.splitlines() if str(config) in line]


def closing_threads():
    return [thread for thread in threading.enumerate() if thread.name == "minerva-close"]


def test_processes_give_the_same_string_and_the_same_tables():
    here = run(pond(), frames=20, seed=5, collect=COLLECT)
    there = run(pond(), frames=20, seed=5, collect=COLLECT, processes=2)
    assert there.digest == here.digest
    assert there.scene == here.scene
    assert there.events == here.events
    assert there.tables.keys() == here.tables.keys()
    for name, table in here.tables.items():
        assert list(table.rows()) == list(there.table(name).rows())


def test_a_number_of_processes_replaces_that_of_the_world_file():
    here = run("meadow", frames=5, seed=5)
    assert run("meadow", frames=5, seed=5, processes=1).digest == here.digest


def test_a_live_world_in_processes_is_the_same():
    steps = (1, 7)
    digests = []
    for bus in (False, True):
        with pond(seed=5).start(bus=bus) as live:
            assert live.frame == 0
            seen = [live.digest]
            for frames in steps:
                live.publish(eFeed(amount=1.0))
                live.step(frames)
                seen.append(live.digest)
            assert live.frame == 8
            digests.append([*seen, live.view("ePicture").digest.hex()])
    assert digests[0] == digests[1]
    assert not running()


def test_a_world_elsewhere_is_connected_to():
    with pond(seed=5).start(bus=True) as live:
        with connect("pond", agents=[Frog]) as other:
            assert other.step(3) == 3
            assert other.digest == live.digest
            assert other.view("ePicture") == live.view("ePicture")
            assert other.status.world == "pond"
        with connect() as unknown, pytest.raises(MisuseError, match="class of AFrog"):
            unknown.view("ePicture")
        with pytest.raises(MisuseError, match="a world in this process only"):
            _ = live.sent
        live.step()
        assert live.frame == 4  # Closing a connection does not end the world.
    with pytest.raises(BusError, match="no world"):
        connect("pond")


def test_a_wrong_world_is_explained_and_leaves_no_process(tmp_path):
    with pond().start(bus=True), pytest.raises(MinervaError, match="runs here already"):
        run(pond(), frames=1, bus=True)
    assert not running()


def test_processes_end_with_the_program_that_started_them(tmp_path):
    program = (
        "import sys, time; from frogs import pond\n"
        "live = pond().start(bus=True); live.step(); print('ready', flush=True); time.sleep(60)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    for number in (signal.SIGKILL, signal.SIGINT):
        with subprocess.Popen(
            [sys.executable, "-c", program], env=environment, stdout=subprocess.PIPE, text=True,
            stderr=subprocess.DEVNULL,
        ) as process:  # fmt: skip
            assert process.stdout.readline() == "ready\n"
            process.send_signal(number)
            process.wait()
        eventually(lambda: not running())


def test_a_launcher_that_cannot_end_itself_is_killed_with_the_program_that_started_it():
    """A stopped process does not handle SIGTERM."""
    program = (
        "import time; from frogs import pond\n"
        "live = pond().start(bus=True); live.step()\n"
        "print(live._backend._launched.pid, flush=True); time.sleep(60)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    with subprocess.Popen(
        [sys.executable, "-c", program], env=environment, stdout=subprocess.PIPE, text=True,
        stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        os.kill(int(process.stdout.readline()), signal.SIGSTOP)
        process.kill()
    eventually(lambda: not running())


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_an_exception_in_the_context_of_a_live_world_ends_its_processes(error):
    live = pond().start(bus=True)
    config = config_of(live)
    assert len(processes_of(config)) > 2

    def fail():
        live.step()
        raise error

    with pytest.raises(error), live:
        fail()
    eventually(lambda: not processes_of(config) and not closing_threads())
    assert not config.parent.exists()


def test_a_live_world_without_references_ends():
    live = pond().start(bus=True)
    live.step()
    config = config_of(live)
    with connect("pond") as other:
        assert other.frame == 1
    del live
    eventually(lambda: not processes_of(config) and not closing_threads())
    assert not config.parent.exists()
    assert not running()


def after_questions(monkeypatch, live, action):
    """Call `action` at the third status query of a step."""
    left, status = [action, None, None], live.operator.status

    def asked():
        if left and (act := left.pop()):
            act()
        return status()

    monkeypatch.setattr(live._backend.operator, "status", asked)


def test_an_interrupted_step_leaves_a_world_that_can_be_closed(monkeypatch):
    def interrupt():
        raise KeyboardInterrupt

    with pond().start(bus=True) as live:
        config = config_of(live)
        after_questions(monkeypatch, live, interrupt)
        with pytest.raises(KeyboardInterrupt):
            live.step(10**6)
    eventually(lambda: not processes_of(config) and not closing_threads())


def test_code_that_fails_in_a_step_is_an_exception_as_in_this_process():
    for bus in (False, True):
        with marsh().start(bus=bus) as live:
            assert live.step(2) == 2
            for _ in range(2):  # Also of a world that has failed before.
                with pytest.raises(WorldStopped, match=r"failed in frame 2: .*no more flies") as at:
                    live.step(5)
                assert live.ended
                # The reader's line, although on the bus another process has executed it.
                shown = report(at.value).splitlines()
                assert len(shown) <= 10
                assert any(line.strip().startswith("raise ValueError") for line in shown)
        assert live.frame == 2
    assert not running()


def test_the_last_string_of_a_world_in_processes_remains_after_its_end():
    done = run(pond(), frames=4, seed=5)
    with pond(seed=5).start(bus=True, frames=4) as live:
        assert live.step(100) == 4
        assert live.ended
        assert (live.frame, live.digest) == (done.frames, done.digest)
    with pond(seed=5).start(bus=True) as closed:
        closed.step(4)
    assert closed.step() == 4
    assert (closed.frame, closed.digest) == (done.frames, done.digest)
    with pytest.raises(BusError, match="no world"):
        connect("pond")


def test_a_step_requests_the_string_only_when_it_is_read(monkeypatch):
    with pond(seed=5).start(bus=True) as live:
        client, questions = live._backend._client, []
        ask = client.ask
        monkeypatch.setattr(client, "ask", lambda name: questions.append(name) or ask(name))
        live.step(3)
        assert questions == []
        assert live.scene == run(pond(), frames=3, seed=5).scene
        assert questions == ["scene"]


def test_a_launcher_that_is_killed_ends_its_world(monkeypatch):
    with pond().start(bus=True) as live:
        config, pid = config_of(live), live._backend._launched.pid
        after_questions(monkeypatch, live, lambda: os.kill(pid, signal.SIGKILL))
        with pytest.raises(MinervaError, match="ended without a message"):
            live.step(10**6)
        assert live.ended
    eventually(lambda: not processes_of(config) and not closing_threads())


def test_a_second_interrupt_kills_processes_that_do_not_end(monkeypatch):
    live = pond().start(bus=True)
    config, process = config_of(live), live._backend._launched._process
    process.send_signal(signal.SIGSTOP)  # Otherwise it ends on its own.
    wait = process.wait

    def interrupted(seconds=None):
        if seconds is not None:
            raise KeyboardInterrupt
        return wait()

    monkeypatch.setattr(process, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        live.close()
    eventually(lambda: not processes_of(config))


def test_a_program_that_closes_no_world_ends_without_a_message():
    program = "from frogs import pond; live = pond().start(bus=True); print(live.step())"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "1\n", "")
    assert not running()


def test_an_interrupted_run_on_the_bus_has_its_string_and_its_tables():
    def interrupt():
        eventually(lambda: any(world.endpoint for world in running()))
        with connect("pond") as other:
            eventually(lambda: other.frame > 3)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(Interrupted) as error:
        run(pond(), frames=0, seed=5, bus=True, collect=COLLECT)
    thread.join()
    done = error.value.run
    assert done.frames > 3
    assert done.ended == "interrupted"
    assert done.table()["frame"].tolist() == [*range(done.frames + 1)]
    assert done.scene == run(pond(), frames=done.frames, seed=5).scene
    assert not running()
