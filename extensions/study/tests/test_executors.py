"""Studies in the workers of executors: the same results as on this machine."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from extensions.study.tests.bombs import ALWAYS, MARK, NEVER, ONCE, bombs, fuse
from extensions.study.tests.ponds import pond as pond_file
from minerva_bus import Agent, World, count, each, on
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.settings.world_settings import AS_WRITTEN
from minerva_study import evolve_strings, executor_pool, sweep
from minerva_study.sent_world import SentWorld
from tests.api.frogs import Frog, eTick, marsh, pond

pytestmark = pytest.mark.timeout(300)


def frogs(options):
    return Frog.many("f", options["n"])


def many():
    services = [each(eTick)]
    return World(frogs, agents=[Frog], services=services, options={"n": 2}, name="many")


def table_of(executor=None, frames=5, seeds=4):
    table = sweep(
        many(), {"n": [2, 5]}, seeds=seeds, frames=frames,
        collect={"frogs": count(Frog), "x": Frog.x, "mood": Frog.mood},
        table="AFrog", executor=executor, quiet=True,
    )  # fmt: skip
    return {name: table[name].tolist() for name in table.columns}


def largest(outcome):
    return max(node.state["size"] for node in outcome.scene.nodes if hasattr(node, "state"))


@pytest.fixture(scope="module")
def cluster():
    """A Dask cluster of two processes, forked by a server that has imported Dask."""
    distributed = pytest.importorskip("distributed")
    dask = pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=2, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.mark.parametrize("method", ["threads", "fork", "spawn"])
def test_a_pool_of_python_gives_the_table_of_local_processes(method):
    if method == "threads":
        pool = ThreadPoolExecutor(3)
    else:
        pool = ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method))
    with pool:
        assert table_of(pool) == table_of()


def test_a_cluster_that_loses_a_worker_gives_the_table_of_local_processes(cluster):
    pid, seen = next(iter(cluster.run(os.getpid).values())), threading.Event()

    def lose():
        while not any(cluster.processing().values()):
            time.sleep(0.001)
        os.kill(pid, signal.SIGKILL)
        seen.set()

    killer = threading.Thread(target=lose)
    killer.start()
    table = table_of(cluster.get_executor(), frames=40)
    killer.join()
    assert seen.is_set()
    assert table == table_of(frames=40)


def test_strings_evolve_in_a_cluster_as_on_this_machine(cluster):
    given = {"population": 4, "generations": 2, "frames": 2, "mutable": ["AFrog.size=0:9"]}
    here = evolve_strings(pond(), largest, **given, quiet=True)
    there = evolve_strings(pond(), largest, **given, executor=cluster.get_executor(), quiet=True)
    assert (there.digest, there.fitness) == (here.digest, here.fitness)
    assert there.generations["median"].tolist() == here.generations["median"].tolist()


def minerva(folder, *words):
    return subprocess.Popen(
        [sys.executable, "-m", "minerva_bus", *words],
        cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def test_commands_run_in_a_cluster(cluster, tmp_path):
    world, address = pond_file(tmp_path), cluster.scheduler.address
    evolution = (
        "evolve", str(world), "--fitness", "pond_of_buds:size", "--population", "4",
        "--generations", "1", "--mutable", "ABud.vigour=0:1", "--json", "--in-process",
    )  # fmt: skip
    here, there = [
        json.loads(minerva(tmp_path, *evolution, *more).communicate()[0])
        for more in ((), ("--dask", address))
    ]
    assert here == there
    words = "sweep", str(world), "--set", "vigour=0.5,4.0", "--json", "--dask", address
    out, _ = minerva(tmp_path, *words).communicate()
    result = json.loads(out)
    assert result["runs"] == 2
    (failed,) = result["failed"]
    assert failed["set"] == {"vigour": "4.0"}
    assert "ValueError: burst" in failed["error"]
    assert "in Bud.grow" in failed["error"]
    assert failed["error"].count("\n") < 10


def test_an_interrupt_leaves_no_task_in_a_cluster(cluster, tmp_path):
    world = pond_file(tmp_path)
    words = "--set", "seed=0:50", "--frames", "100000", "--dask", cluster.scheduler.address
    running = minerva(tmp_path, "sweep", str(world), *words)
    while not any(cluster.processing().values()):
        assert running.poll() is None, running.communicate()
        time.sleep(0.01)
    running.send_signal(signal.SIGINT)
    out, err = running.communicate()
    assert running.returncode == 130, err
    assert "interrupted with 50 runs left" in out

    def tasks(dask_worker):
        return len(dask_worker.state.tasks)

    # The running tasks end after the frame in progress.
    while any(cluster.run(tasks).values()):
        time.sleep(0.01)


def test_no_cluster_at_an_address_is_explained_in_one_line(tmp_path):
    pytest.importorskip("distributed")
    words = "--set", "seed=0:2", "--dask", "127.0.0.1:1"
    running = minerva(tmp_path, "sweep", str(pond_file(tmp_path)), *words)
    _, err = running.communicate()
    assert running.returncode == 2
    assert "no scheduler answers" in err
    assert len(err.splitlines()) == 1


def test_a_run_that_fails_names_its_parameters_and_the_line_of_code(capsys):
    with ThreadPoolExecutor(2) as pool, pytest.raises(MisuseError, match="seed=0: agents failed"):
        sweep(marsh(), seeds=2, frames=5, executor=pool, quiet=True)
    lines = capsys.readouterr().err.splitlines()
    assert sum("seed=1: agents failed in frame 2" in line for line in lines) == 1
    assert any('raise ValueError("no more flies")' in line for line in lines)
    assert len(lines) <= 20


def test_a_run_that_takes_too_long_fails():
    with ThreadPoolExecutor(2) as pool, pytest.raises(MisuseError, match=r"took more than 0\.2 s"):
        sweep(many(), seeds=2, frames=10**9, limit=0.2, executor=pool, quiet=True)


def test_an_executor_that_cannot_work_is_explained():
    number: Any = 3
    with pytest.raises(MisuseError, match="3 is not an executor"):
        sweep(many(), seeds=2, frames=2, executor=number, quiet=True)
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(MinervaError, match="the executor accepts no task"):
        sweep(many(), seeds=2, frames=2, executor=pool, quiet=True)

    class Here(Agent, symbol="AHere"):
        @on("eTick")
        def live(self, tick, moment):
            """Do nothing."""

    world = World("AHere#a", agents=[Here], services=[each(eTick)])
    with ThreadPoolExecutor(1) as pool, pytest.raises(MisuseError, match="move it into a module"):
        sweep(world, seeds=2, frames=2, executor=pool, quiet=True)


def test_a_broken_pool_is_no_result():
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        pid = pool.submit(os.getpid).result()

        def lose():
            while not pool._pending_work_items:
                time.sleep(0.001)
            os.kill(pid, signal.SIGKILL)

        killer = threading.Thread(target=lose)
        killer.start()
        problem = r"the executor cannot go on: BrokenProcessPool: .*executor=lambda"
        with pytest.raises(MinervaError, match=problem):
            table_of(pool, frames=200, seeds=40)
        killer.join()


def two_workers():
    return ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("fork"))


@pytest.fixture
def mark(tmp_path, monkeypatch):
    """The file that exists after a bomb has killed its process."""
    made = tmp_path / "mark"
    monkeypatch.setenv(MARK, str(made))
    return made


def explode(fuses, **settings):
    return sweep(bombs(), {"fuse": fuses}, seeds=3, frames=3, quiet=True, **settings)


def test_a_study_continues_in_a_new_pool_after_a_worker_was_killed(mark, capsys):
    table = explode([NEVER, ONCE], executor=two_workers)
    assert mark.exists()
    # Bombs that kill once are harmless from now on.
    assert table["digest"].tolist() == explode([NEVER, ONCE])["digest"].tolist()
    assert set(table["error"]) == {""}
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "reopening" in line]
    assert "a worker ended while it ran fuse=" in line
    assert "fuse=1, seed=" in line
    assert line.endswith("reopening the executor (1 of 10)")


def test_runs_that_always_kill_their_worker_fail_and_all_others_succeed(mark, capsys):
    table = explode([NEVER, ALWAYS], executor=two_workers)
    dead = table["fuse"] == ALWAYS
    assert set(table["error"][dead]) == {"its worker process ended, twice"}
    assert set(table["error"][~dead]) == {""}
    assert table["frames"][~dead].tolist() == [3, 3, 3]
    lines = capsys.readouterr().err.splitlines()
    for seed in range(3):
        assert f"bombs │ fuse=2, seed={seed}: its worker process ended, twice" in lines


def test_a_pool_is_reopened_a_bounded_number_of_times(mark, monkeypatch):
    monkeypatch.setattr(executor_pool, "MAX_REOPENED", 2)
    problem = r"a worker ended while it ran fuse=2, seed=\d.*; it was reopened 2 times already"
    with pytest.raises(MinervaError, match=problem):
        explode([ALWAYS], executor=two_workers)


def test_a_killed_worker_of_an_open_pool_names_its_runs(mark):
    problem = r"while it ran fuse=2, seed=\d.*give a function that opens an executor"
    with two_workers() as pool, pytest.raises(MinervaError, match=problem):
        explode([ALWAYS], executor=pool)


def test_strings_that_kill_their_worker_are_not_the_best(mark):
    mark.touch()  # Which string would explode once depends on the order of runs.
    given = {"population": 4, "generations": 1, "frames": 2, "mutable": ["ABomb.fuse=0:2"]}
    here = evolve_strings(bombs(), fuse, **given, quiet=True)
    there = evolve_strings(bombs(), fuse, **given, executor=two_workers, quiet=True)
    assert (there.digest, there.fitness) == (here.digest, here.fitness)
    assert there.generations["failed"].tolist() == here.generations["failed"].tolist()
    assert there.generations["failed"].max() > 0


def sent(**changes):
    made = SentWorld.of(pond().toml(), Path("pond.toml"), AS_WRITTEN)
    return SentWorld(**{**vars(made), **changes})


@pytest.mark.parametrize(("changes", "problem"), [
    ({"modules": ("no_such_frogs",)}, r"has no module no_such_frogs: .*upload_file"),
    ({"code": {"tests.api.frogs.Frog.live": "0"}},
     r"has another version of tests\.api\.frogs\.Frog\.live"),
    ({"version": "0.0"}, r"has Minerva Bus \S+, not 0\.0: install the same version"),
])  # fmt: skip
def test_a_worker_without_the_code_of_a_world_is_named(changes, problem):
    sent().check()
    with pytest.raises(MinervaError, match=rf"^the worker \S+:{os.getpid()} {problem}"):
        sent(**changes).check()
