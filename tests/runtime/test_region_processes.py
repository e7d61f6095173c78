"""Regions as processes: the run of one coordinator, operators, records, and processes that die."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
import running
from region_proxy import SCRIPT, Proxy
from running import (
    MEMBERS,
    PATIENCE,
    Run,
    World,
    alive,
    children,
    environment,
    eventually,
    here,
    minerva,
    summary,
    write_world,
)

from minerva_bus import Event
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.regions.journal import FileJournal
from minerva_bus.log.comparison import compare
from minerva_bus.log.reader import Record
from minerva_bus.runtime.region_links import ParcelArrived

LOUD = """
from minerva_bus import Event
from yard import *

class LoudSteps(Steps, events=("eStep",)):
    def generate(self, tick):
        if tick.number == 5:
            print("tick")
        return super().generate(tick)

class Talker(Walker, symbol="AWalker"):
    @on("eStep")
    def walk(self, step, moment):
        to = "abcd"[moment.number % 4]
        moment.emit(eWish(self.x + 1, self.id, receivers=[to]))
        return super().walk(step, moment)
"""


BELL = """
from yard import *

class Bell(Generator, events=("eWish",), lockstep=False):
    name = "bell"

    def run(self, emit, stop):
        number = 0
        while not stop.wait(0.02):
            number += 1
            emit(eWish(float(number), self.name, receivers=["abcd"[number % 4]]))

class Drum(Bell):
    name = "drum"
"""


HOSTS = """
processes = 2

[regions]
hosts = ["walkers"]
"""

FAULTY = """
import time
import yard
from yard import *

class Walker(yard.Walker, symbol="AWalker"):
    @on("eStep")
    def walk(self, step, moment):
        if moment.number == 5 and self.id == "b":
            FAULT
        return super().walk(step, moment)
"""

DEFECTS = """
from pathlib import Path
from minerva_bus.cli.main import main
from minerva_bus.regions.region import Region
from minerva_bus.regions.whole import WholeSource

commit, leave = WholeSource.commit, Region.leave

def fails(name):
    path = Path(name)
    if not path.exists():
        path.write_text("once")
        raise LookupError(f"a defect of ours: {name}")

def failing_commit(self):
    frame = self._algorithm.frame
    if self._algorithm.in_flight.logged is None:
        with Path("begun").open("a") as begun:
            print(frame, file=begun)
    if frame == 10:
        fails("coordinator")
    commit(self)

def failing_leave(self):
    if (self.number, self.frame) == (1, 20):
        fails("region")
    return leave(self)

WholeSource.commit, Region.leave = failing_commit, failing_leave
main()
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "loud.py").write_text(LOUD)
    return write_world(tmp_path, MEMBERS.replace("yard:Steps", "loud:LoudSteps"))


def alone(path, frames, *words):
    """The summary of the world in one process, with one coordinator."""
    words = "--in-process", "--rate", 0, "--frames", frames, "--json", *words
    return summary(here(path.parent, "run", path, *words))


def digests(path):
    with Record(path) as record:
        return [frame.digest for frame in record.frames()]


def test_a_record_of_regions_with_lag_and_defects_is_that_of_one_coordinator(path):
    """Exceptions in the coordinator and in a region: each continues in the same frame."""
    folder, text = path.parent, path.read_text().replace("yard:Walker", "loud:Talker")
    text += '\n[norm.few]\non = ["eWish"]\nmost = 2\nper = 5\nthen = "refuse"\n'
    path.write_text(f"{text}\n[regions]\ncount = 3\nlag = 2\nmove_every = 7\n")
    words = "--rate", "0", "--record", "regions.mcap", "--json"
    (folder / "defects.py").write_text(DEFECTS)
    done = subprocess.run(
        [sys.executable, "defects.py", "run", path, *words], cwd=folder, env=environment(folder),
        capture_output=True, text=True, timeout=PATIENCE, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    regions = summary(done)
    assert "a defect of ours: coordinator" in done.stderr
    ours = (
        "region-1: an error of Minerva Bus, not of the world's code: LookupError: a defect of ours"
    )
    assert ours in done.stderr
    assert (folder / "begun").read_text().split() == [*map(str, (*range(11), *range(10, 30)))]
    single = alone(path, 30, "--regions", 0, "--record", "one.mcap")
    path.write_text(text)
    assert alone(path, 30)["digest"] != single["digest"]
    same = ("digest", "frames", "ended", "reached", "steps", "norm_few")
    assert {name: regions[name] for name in same} == {name: single[name] for name in same}
    assert regions["regions"] == regions["members"] == 3
    assert digests(folder / "regions.mcap") == digests(folder / "one.mcap")
    with Record(folder / "regions.mcap") as a, Record(folder / "one.mcap") as b:
        assert a.end()[0].frame == 30
        difference = compare(a, b)
    assert difference.frame is None, difference
    assert not difference.before
    done = here(folder, "replay", "regions.mcap", path, "--recompute")
    assert done.returncode == 0, done.stdout + done.stderr


def test_an_interrupt_ends_all_regions_after_the_same_frame(path):
    words = "--rate", 100, "--frames", 0, "--regions", 3, "--json"
    with World(path, *words) as world:
        for number in range(3):
            world.says(f"region-{number}", "tick")
        processes = children(world.process.pid)
        assert len(processes) == 4
        world.kill(signal.SIGINT)
        assert world.ends() == 130, world.text
        ended = json.loads("\n".join(world.output))
    assert ended["ended"] == "interrupted"
    assert ended["digest"] == alone(path, ended["frames"])["digest"]
    eventually(lambda: not any(map(alive, processes)), "all processes have ended")


def test_operators_and_deaths_leave_one_run(path):
    """Pause, an order, a killed region, steps and the end: as if with one coordinator."""
    folder = path.parent
    words = "--rate", 100, "--frames", 0, "--regions", 3, "--record", "run.mcap", "--json"
    with World(path, *words) as world:
        pids = world.runs("region-0", "region-1", "region-2")
        paused = summary(here(folder, "pause", "--json"))["frame"]
        os.kill(pids["region-1"], signal.SIGKILL)
        world.says("region-1", "was killed by SIGKILL")
        summary(here(folder, "pub", "eWish", "x=2", "name=hill", "--to", "c", "--json"))
        done = here(folder, "step", 5, "--json")
        assert done.returncode == 0, world.text
        assert summary(done)["frame"] == paused + 5
        eventually(lambda: world.members() and world.frame == paused + 5, "five steps")
        assert here(folder, "rate", 0).returncode == 0
        assert here(folder, "resume").returncode == 0
        eventually(lambda: world.members() and world.frame > paused + 20, "more frames")
        assert here(folder, "stop").returncode == 0
        ended = world.summary()
    with Record(folder / "run.mcap") as record:
        orders = [
            frame.number
            for frame in record.frames()
            for event in frame.events
            if event.type == "eWish"
        ]
        assert orders == [paused]
        assert record.end()[0].frame == ended["frames"]
    # One coordinator computes the same strings from the recorded events.
    done = here(folder, "replay", "run.mcap", path, "--recompute")
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_coordinator_that_is_killed_is_followed_and_regions_stay(path):
    folder = path.parent
    words = "--rate", 20, "--frames", 60, "--regions", 2, "--record", "run.mcap", "--json"
    with World(path, *words) as world:
        before = world.runs("region-0", "region-1")
        world.kill_coordinator()
        assert world.runs("region-0", "region-1") == before
        assert here(folder, "pause").returncode == 0
        done = here(folder, "explain", world.name, "--agent", "a", "--attribute", "x")
        assert "the generator steps sent eStep" in done.stdout, done.stdout + done.stderr
        assert here(folder, "resume").returncode == 0
        ended = world.summary()
    assert "region-0 │ was killed" not in world.text
    assert ended["digest"] == alone(path, 60, "--record", "one.mcap")["digest"]
    assert digests(folder / "run.mcap") == digests(folder / "one.mcap")


def test_a_run_that_was_killed_continues_from_its_journal(path):
    words = "--rate", 20, "--frames", 40, "--regions", 2, "--journal", "journal"
    with World(path, *words) as world:
        world.runs("region-0", "region-1")
        eventually(lambda: world.members() and world.frame > 10, "frames")
        world.kill()
        world.ends()
        world.gone()
    with World(path, *words) as world:
        assert world.ends() == 0, world.text
    assert "continuing from frame" in world.text
    assert alone(path, 40)["digest"] in "\n".join(world.output)


@pytest.mark.slow
def test_links_that_are_cut_delay_a_world_and_nothing_else(path, monkeypatch):
    """For longer than a lease, after which Zenoh closes a link and dials again, and for less."""
    script = path.parent / "proxied.py"
    script.write_text(SCRIPT)
    monkeypatch.setattr(running, "MINERVA", [sys.executable, str(script)])
    words = "--rate", 20, "--frames", 100, "--regions", 3, "--json"
    with tempfile.TemporaryDirectory() as folder:  # Paths of sockets must be short.
        monkeypatch.setenv("TMPDIR", folder)
        with World(path, *words) as world:
            sockets = eventually(lambda: [*Path(folder).glob("minerva-regions-*")], "a folder")[0]
            proxies = [Proxy(sockets, number) for number in range(2)]
            for proxy in proxies:
                proxy.start()
            for seconds in (0.1, 1.0, 10.0):
                world.runs("region-0", "region-1", "region-2")
                for proxy in proxies:
                    proxy.cut()
                time.sleep(seconds)
                for proxy in proxies:
                    proxy.restore()
            assert world.summary()["digest"] == alone(path, 100)["digest"]


@pytest.mark.parametrize(
    ("name", "grid", "given", "frames", "same"),
    [
        ("crowd", "x = [12]", ("--people", 60), 30, ("digest", "collisions", "inside")),
        # Robots cross the border, with true poses that the string does not have.
        ("robots", "row = [14]", ("--alpha", 0.01), 60, ("digest", "collisions")),
    ],
)
def test_a_region_with_halos_that_is_killed_is_followed(tmp_path, name, grid, given, frames, same):
    """People near the border are shown to both regions, and contacts move along with them."""
    source = find_world(name)
    for file in source.parent.iterdir():
        if file.is_file():
            (tmp_path / file.name).write_bytes(file.read_bytes())
    path = tmp_path / source.name
    text = path.read_text(encoding="utf-8")
    path.write_text(f"{text}\n[regions]\ngrid = {{ {grid} }}\nhalo = true\n", encoding="utf-8")
    words = "--rate", 50, "--frames", frames, *given, "--record", "run.mcap", "--json"
    with World(path, *words) as world:
        pids = world.runs("region-0", "region-1")
        eventually(lambda: world.members() and world.frame > 5, "frames")
        os.kill(pids["region-1"], signal.SIGKILL)
        world.says("region-1", "was killed by SIGKILL")
        ended = world.summary()
    single = alone(path, frames, *given, "--regions", 0, "--record", "one.mcap")
    assert {name: ended[name] for name in same} == {name: single[name] for name in same}
    with Record(tmp_path / "run.mcap") as a, Record(tmp_path / "one.mcap") as b:
        assert compare(a, b).frame is None


def test_generators_that_run_freely_are_beside_the_regions(path):
    """Their events count in the same frame in all regions, also if the coordinator is killed."""
    folder = path.parent
    (folder / "bell.py").write_text(BELL)
    processes = '[process.bell]\nservice = "bell:Bell"\n'
    regions = "[regions]\ngrid = { x = [1.5] }\nbalance = 7"
    path.write_text(path.read_text().replace("[bus]", f"{processes}\n{regions}\n[bus]"))
    words = "--rate", 20, "--frames", 0, "--record", "run.mcap", "--json"
    with World(path, *words) as world:
        world.runs("region-0", "region-1", "bell")
        with Run(folder, "attach", "bell:Drum", "--name", "drum"):
            world.runs("drum")
            world.kill_coordinator()
            world.runs("bell", "drum")
            frame = world.frame
            eventually(lambda: world.members() and world.frame > frame + 10, "more frames")
        assert here(folder, "stop").returncode == 0
        ended = world.summary()
    assert ended["members"] == 4
    with Record(folder / "run.mcap") as record:
        sent = [
            (event.data["name"], event.data["x"])
            for frame in record.frames()
            for event in frame.events
            if isinstance(event, Event) and event.type == "eWish"
        ]
    assert {name for name, _ in sent} == {"bell", "drum"}
    assert len(set(sent)) == len(sent)
    done = here(folder, "replay", "run.mcap", path, "--recompute")
    assert done.returncode == 0, done.stdout + done.stderr


def test_views_are_beside_the_regions(path):
    """An observer in real time has the views of the whole, as with one coordinator."""
    screen = """
[process.screen]
service = "live:LiveScreen"
said = true
"""
    # Another module than that of other tests, which this process has imported.
    (path.parent / "live.py").write_text(
        "from yard import Screen\n\nclass LiveScreen(Screen, draws=('eShow',)):\n    rate = 50.0\n"
    )
    path.write_text(path.read_text().replace("[bus]", f"{screen}\n[bus]"))
    words = "--rate", 20, "--frames", 30, "--regions", 2, "--json"
    with World(path, *words, "--record", "run.mcap") as world:
        world.says("screen", "4 figures")
        ended = world.summary()
    assert ended["members"] == 3
    assert ended["pictures"] > 0
    with Record(path.parent / "run.mcap") as record:
        assert any(e.type == "eShow" for frame in record.frames() for e in frame.events)
    assert ended["digest"] == alone(path, 30)["digest"]
    done = here(path.parent, "run", path, "--regions", 2, "--in-process")
    assert "views in real time (screen) in one process" in done.stderr


def advances(world):
    frame = world.frame
    eventually(lambda: world.members() and world.frame > frame + 5, "more frames")


def test_hosts_their_regions_and_the_coordinator_may_die(tmp_path):
    path = write_world(tmp_path, MEMBERS + HOSTS)
    hosts = [f"region-{region}.walkers-{number}" for region in range(2) for number in (1, 2)]
    words = "--rate", 50, "--frames", 0, "--regions", 2, "--record", "run.mcap", "--json"
    with World(path, *words) as world:
        pids = world.runs("region-0", "region-1", *hosts)
        for name in (hosts[0], "region-1"):
            os.kill(pids[name], signal.SIGKILL)
            world.says(name, "was killed by SIGKILL")
            advances(world)
        # The status is that of the last second.
        eventually(lambda: world.runs(*hosts)[hosts[0]] != pids[hosts[0]], "another host")
        # The hosts of a region that has died join its successor.
        new = world.runs(*hosts)
        assert [name for name in hosts if new[name] != pids[name]] == hosts[:1], world.text
        assert "region-1.walkers" not in world.text
        assert here(tmp_path, "restart", world.name, hosts[3]).returncode == 0
        world.says(hosts[3], "restarting on request")
        world.kill_coordinator()
        advances(world)
        assert here(tmp_path, "stop").returncode == 0
        ended = world.summary()
    assert ended["digest"] == alone(path, ended["frames"], "--regions", 0)["digest"]
    done = here(tmp_path, "replay", "run.mcap", path, "--recompute")
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_region_that_waits_for_a_host_is_not_blamed(tmp_path):
    path = write_world(tmp_path, MEMBERS + '\n[regions]\nhosts = ["walkers"]\n')
    with World(path, "--rate", 50, "--frames", 0, "--regions", 2, "--json") as world:
        pid = world.runs("region-0.walkers", "region-1.walkers")["region-1.walkers"]
        os.kill(pid, signal.SIGSTOP)

        def explained():
            done = here(tmp_path, "explain", world.name)
            return "the process of region-1.walkers is stopped, by SIGSTOP" in done.stdout

        try:
            eventually(explained, world.text)
        finally:
            os.kill(pid, signal.SIGCONT)
        advances(world)
        done = here(tmp_path, "restart", world.name, "region-1.walker")
        assert "did you mean 'region-1.walkers'?" in done.stderr
        done = here(tmp_path, "drain", world.name, "walkers")
        assert "hosts of regions (region-0.walkers, region-1.walkers)" in done.stderr


def test_programs_that_are_hosts_reach_a_region_that_has_died(tmp_path):
    """Its next process listens at the port that the system has chosen for the first one."""
    options = "--name $MINERVA_NAME --world $MINERVA_WORLD --connect $MINERVA_CONNECT"
    program = f"exec {sys.executable} -m minerva_bus.cli.main attach yard:Walker {options}"
    command = json.dumps(["sh", "-c", program])
    members = MEMBERS.replace('agents = "yard:Walker"', f"command = {command}")
    path = write_world(tmp_path, members + '\n[regions]\nhosts = ["walkers"]\n')
    hosts = [f"region-{region}.walkers" for region in range(2)]
    with World(path, "--rate", 50, "--frames", 0, "--regions", 2, "--json") as world:
        pids = world.runs("region-1", *hosts)
        os.kill(pids["region-1"], signal.SIGKILL)
        world.says("region-1", "was killed by SIGKILL")
        advances(world)
        new = world.runs("region-1", *hosts)
        assert [new[name] == pids[name] for name in new] == [False, True, True], world.text
        assert here(tmp_path, "stop").returncode == 0
        ended = world.summary()
    plain = write_world(tmp_path, MEMBERS)
    assert ended["digest"] == alone(plain, ended["frames"], "--regions", 0)["digest"]


@pytest.mark.parametrize(("fault", "reported"), [
    ("raise ValueError('broken')", "failed again with the same error in the same frame"),
    pytest.param("time.sleep(1000)", "did not answer for 1.* s .blocked as above.; restart 2 of 2", marks=pytest.mark.slow),
])  # fmt: skip
def test_a_host_of_a_region_that_fails_is_reported_like_any_host(tmp_path, fault, reported):
    (tmp_path / "faulty.py").write_text(FAULTY.replace("FAULT", fault))
    members = MEMBERS.replace("yard:Walker", "faulty:Walker")
    path = write_world(tmp_path, f"{members}restarts = 2\nhard = 1.0{HOSTS}")
    done = minerva(tmp_path, "run", path, "--rate", 0, "--regions", 2)
    assert done.returncode == 1, done.stderr
    assert re.search(rf"region-[01].walkers-[12] │ {reported}", done.stderr), done.stderr
    assert "the world stops" in done.stderr


def test_what_code_in_a_region_prints_about_a_host_is_no_report(path):
    host = "region-0.walkers-1"
    lines = f"{host}: no answer for 1.0 s", f"{host}: failed in frame 5: broken"
    text = path.parent / "loud.py"
    printed = f"print({lines[0]!r}, {lines[1]!r}, sep=chr(10))"
    text.write_text(LOUD.replace('print("tick")', printed))
    members = MEMBERS.replace("yard:Steps", "loud:LoudSteps")
    path = write_world(path.parent, members + HOSTS)
    words = "--rate", 0, "--frames", 30, "--regions", 2
    done = minerva(path.parent, "run", path, *words)
    assert done.returncode == 0, done.stderr
    for line in lines:
        assert re.search(rf"region-0 │ {re.escape(line)}", done.stderr + done.stdout), done.stderr
    assert "killing it" not in done.stderr + done.stdout


@pytest.mark.parametrize(("fault", "reported"), [
    ('raise ValueError("broken")', "failed in frame 5: steps: LoudSteps.generate: ValueError"),
    # A new process would do the same.
    ("return [Event('eStep', ('count',), (1,), sender='a')]", "failed in frame 5: .*steps: it sent eStep from #a, but"),
])  # fmt: skip
def test_an_error_in_code_stops_all_regions(path, fault, reported):
    (path.parent / "loud.py").write_text(LOUD.replace('print("tick")', fault))
    done = minerva(path.parent, "run", path, "--rate", 0, "--regions", 2)
    assert done.returncode == 1
    assert re.search(f"region-[01] │ {reported}", done.stderr)


@pytest.mark.parametrize(("size", "frames"), [(100, 10), (20 << 16, 20), (14 << 20, 200)])
def test_a_process_repeats_few_frames_unless_checkpoints_are_large(tmp_path, size, frames):
    """A checkpoint is never due more often than it takes 64 KiB of a frame."""
    journal = FileJournal(tmp_path / "0.journal")
    journal.open()
    journal.begin_again(bytes(size))
    due = [journal.is_due() for _ in range(frames + 1)]
    assert due == [False] * frames + [True]


def test_a_journal_omits_an_entry_that_was_cut_off(tmp_path):
    path, parcels = tmp_path / "journal", [ParcelArrived(n, bytes(n)) for n in (2, 0, 1)]
    journal = FileJournal(path)
    journal.open()
    for parcel in parcels:
        journal.write(parcel)
    os.truncate(path, path.stat().st_size - 1)
    assert list(FileJournal(path).read()) == parcels[:2]
    journal.write(parcels[2])
    assert list(FileJournal(path).read()) == parcels


def test_a_coordinator_and_a_region_that_are_stopped_for_good(path):
    done = alone(path, 60)
    with World(path, "--regions", 2, "--frames", 60, "--rate", 20, "--json") as world:
        region = world.runs("region-0", "region-1")["region-1"]
        for pid in (region, world.coordinator()):
            os.kill(pid, signal.SIGSTOP)
        world.says("coordinator", "stopped by a signal for 10 s: killing it")
        world.says("region-1", "stopped by a signal for 10 s: killing it")
        assert world.ends() == 0, world.text
        assert world.summary()["digest"] == done["digest"]
