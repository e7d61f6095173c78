"""Several members in one process, on a real bus: the same strings, also after failures."""

import os
import re
import signal

import pytest
from running import (
    ALL_KINDS,
    MEMBERS,
    World,
    alone,
    eventually,
    minerva,
    summary,
    write_world,
)

NAMES = ("steps", "walkers", "water", "eye", "screen", "noise")
SHARED = ("steps", "water", "eye", "noise")
"""Without the host of agents, and the observer `screen`."""

AUTO = ("--processes", "auto")


@pytest.fixture(autouse=True)
def few_cores():
    """Two cores for the worlds of a test, so that their services share a process."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(cores)[:2])
    yield
    os.sched_setaffinity(0, cores)


def test_services_share_a_process_and_make_the_same_string(tmp_path):
    path = write_world(tmp_path, ALL_KINDS, frames=120, rate=60)
    with World(path, "--json", *AUTO) as world:
        pids = world.runs(*NAMES)
        assert len({pids[name] for name in SHARED}) == 1
        assert len(set(pids.values())) == 1 + len(NAMES) - len(SHARED)
        ended = world.summary()
        world.gone()
    assert (ended["frames"], ended["digest"]) == (120, alone(path)["digest"])
    apart = summary(minerva(tmp_path, "run", path, "--json"))
    assert apart["digest"] == ended["digest"]


def test_a_killed_process_is_restarted_with_all_of_its_members(tmp_path):
    path = write_world(tmp_path, ALL_KINDS, frames=200, rate=60)
    with World(path, "--json", *AUTO) as world:
        for _ in range(2):
            before = world.runs(*NAMES)
            os.kill(before["eye"], signal.SIGKILL)

            def others(before=before):
                members = world.members()
                return all(
                    members.get(name, {}).get("state") == "present"
                    and members[name]["pid"] != before[name]
                    for name in SHARED
                )

            eventually(others, "another process of these members")
        ended = world.summary()
        world.gone()
    assert re.search(r"^services │ was killed by SIGKILL; restart \d of 5 in", world.text, re.M)
    assert (ended["frames"], ended["digest"]) == (200, alone(path)["digest"])


RASCAL = '\n[process.rascal]\nservice = "yard:Rascal"\ndeed = "{deed}"\n{more}\n'


def test_a_member_that_raises_is_named_and_all_are_restarted(tmp_path):
    memory = tmp_path / "memory"
    members = MEMBERS + RASCAL.format(deed="raises", more=f'memory = "{memory}"')
    path = write_world(tmp_path, members)
    with World(path, "--json", *AUTO) as world:
        ended = world.summary()
        text = world.text
    assert memory.exists()
    assert "rascal │ failed in frame 5: Rascal.generate: ZeroDivisionError" in text
    assert "services │ failed; restart 1 of 5 in 0.05 s" in text
    assert "steps │ is gone" not in text
    assert "Traceback" not in text
    assert (ended["frames"], ended["digest"]) == (30, alone(path)["digest"])


def test_the_summary_names_the_member_that_ends_the_world(tmp_path):
    members = MEMBERS + RASCAL.format(deed="raises", more="")
    path = write_world(tmp_path, members)
    done = minerva(tmp_path, "run", path, *AUTO)
    assert done.returncode == 1
    assert f"{path.stem}: rascal failed in frame 5" in done.stdout


def test_a_coordinator_that_is_killed_is_followed_and_the_process_stays(tmp_path):
    path = write_world(tmp_path, ALL_KINDS, frames=150, rate=30)
    with World(path, "--json", *AUTO) as world:
        before = world.runs(*NAMES)
        for _ in range(2):
            world.kill_coordinator()
            assert world.runs(*NAMES) == before
        ended = world.summary()
        world.gone()
    assert (ended["frames"], ended["digest"]) == (150, alone(path)["digest"])


def test_ctrl_c_ends_the_process(tmp_path):
    path = write_world(tmp_path, ALL_KINDS, frames=0, rate=30)
    with World(path, "--json", *AUTO) as world:
        world.runs(*NAMES)
        world.kill(signal.SIGINT)
        assert world.ends() == 130
        world.gone()


def test_a_member_on_request_is_restarted_with_its_process(tmp_path):
    path = write_world(tmp_path, ALL_KINDS, frames=0, rate=30)
    with World(path, *AUTO) as world:
        before = world.runs(*NAMES)
        done = minerva(tmp_path, "restart", path.stem, "eye")
        assert done.returncode == 0, done.stderr
        eventually(
            lambda: (
                (after := world.runs(*NAMES))["water"] != before["water"]
                and after["walkers"] == before["walkers"]
            ),
            "another process of these members",
        )
