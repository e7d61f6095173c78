"""Several members in one process, on a real bus: the same strings, also after failures."""

import os
import re
import signal

import pytest
from running import ALL_KINDS, MEMBERS, World, eventually, here, minerva, summary, write_world

NAMES = ("steps", "walkers", "water", "eye", "screen", "noise")
SHARED = ("steps", "water", "eye", "noise")
WITH_HOST = (*SHARED, "walkers")


def shared(members=ALL_KINDS, names=SHARED, container="services"):
    """The members of a world file, with these in one container."""
    for name in names:
        table = f"[process.{name}]\n"
        assert table in members
        members = members.replace(table, f'{table}container = "{container}"\n')
    return members


def alone(folder, path):
    """The summary of a run in one process."""
    return summary(here(folder, "run", path, "--in-process", "--rate", "0", "--json"))


@pytest.mark.parametrize("names", [SHARED, WITH_HOST])
def test_members_of_a_container_share_a_process_and_make_the_same_string(tmp_path, names):
    path = write_world(tmp_path, shared(names=names), frames=120, rate=60)
    with World(path, "--json") as world:
        pids = world.runs(*NAMES)
        assert len({pids[name] for name in names}) == 1
        assert len(set(pids.values())) == 1 + len(NAMES) - len(names)
        ended = world.summary()
        world.gone()
    assert (ended["frames"], ended["digest"]) == (120, alone(tmp_path, path)["digest"])
    apart = summary(minerva(tmp_path, "run", path, "--json", *_apart(names)))
    assert apart["digest"] == ended["digest"]


def _apart(names):
    return [word for name in names for word in ("--set", f"{name}.container=")]


@pytest.mark.parametrize("names", [SHARED, WITH_HOST])
def test_a_killed_container_is_restarted_with_all_of_its_members(tmp_path, names):
    path = write_world(tmp_path, shared(names=names), frames=200, rate=60)
    with World(path, "--json") as world:
        for _ in range(2):
            before = world.runs(*NAMES)
            os.kill(before["eye"], signal.SIGKILL)

            def others(before=before):
                members = world.members()
                return all(
                    members.get(name, {}).get("state") == "present"
                    and members[name]["pid"] != before[name]
                    for name in names
                )

            eventually(others, "another process of these members")
        ended = world.summary()
        world.gone()
    assert re.search(r"^services │ was killed by SIGKILL; restart \d of 5 in", world.text, re.M)
    assert (ended["frames"], ended["digest"]) == (200, alone(tmp_path, path)["digest"])


RASCAL = '\n[process.rascal]\nservice = "yard:Rascal"\ndeed = "{deed}"\n{more}\n'


def test_a_member_that_raises_is_named_and_all_are_restarted(tmp_path):
    memory = tmp_path / "memory"
    members = MEMBERS + RASCAL.format(deed="raises", more=f'memory = "{memory}"')
    path = write_world(tmp_path, shared(members, ("steps", "rascal")))
    with World(path, "--json") as world:
        ended = world.summary()
        text = world.text
    assert memory.exists()
    assert "rascal │ failed in frame 5: Rascal.generate: ZeroDivisionError" in text
    assert "services │ failed; restart 1 of 5 in 0.05 s" in text
    assert "steps │ is gone" not in text
    assert "Traceback" not in text
    assert (ended["frames"], ended["digest"]) == (30, alone(tmp_path, path)["digest"])


def test_the_summary_names_the_member_that_ends_the_world(tmp_path):
    members = MEMBERS + RASCAL.format(deed="raises", more="")
    path = write_world(tmp_path, shared(members, ("steps", "rascal")))
    done = minerva(tmp_path, "run", path)
    assert done.returncode == 1
    assert f"{path.stem}: rascal failed in frame 5" in done.stdout


def test_a_coordinator_that_is_killed_is_followed_and_containers_stay(tmp_path):
    path = write_world(tmp_path, shared(), frames=150, rate=30)
    with World(path, "--json") as world:
        before = world.runs(*NAMES)
        for _ in range(2):
            world.kill_coordinator()
            assert world.runs(*NAMES) == before
        ended = world.summary()
        world.gone()
    assert (ended["frames"], ended["digest"]) == (150, alone(tmp_path, path)["digest"])


def test_ctrl_c_ends_a_container(tmp_path):
    path = write_world(tmp_path, shared(), frames=0, rate=30)
    with World(path, "--json") as world:
        world.runs(*NAMES)
        world.kill(signal.SIGINT)
        assert world.ends() == 130
        world.gone()


def test_a_member_on_request_is_restarted_with_its_container(tmp_path):
    path = write_world(tmp_path, shared(), frames=0, rate=30)
    with World(path) as world:
        before = world.runs(*NAMES)
        done = minerva(tmp_path, "restart", path.stem, "eye")
        assert done.returncode == 0, done.stderr
        eventually(
            lambda: (
                (after := world.runs(*NAMES))["water"] != before["water"]
                and after["walkers"] == before["walkers"]
            ),
            "another process of the container",
        )


@pytest.mark.parametrize(
    ("names", "more", "problem"),
    [
        (("screen",), "", r"Screen is an observer.*give it a process of its own"),
        (("steps", "water"), "restarts = 2", "their restarts must be equal: .* steps is 2"),
    ],
)
def test_processes_that_cannot_share_are_refused(tmp_path, names, more, problem):
    members = shared(ALL_KINDS, names).replace('"yard:Steps"', f'"yard:Steps"\n{more}')
    done = here(tmp_path, "check", write_world(tmp_path, members))
    assert done.returncode != 0
    assert re.search(problem, done.stderr + done.stdout, re.S), done.stderr


def test_a_container_has_no_name_of_a_process(tmp_path):
    path = write_world(tmp_path, shared(container="walkers"))
    done = here(tmp_path, "check", path)
    assert done.returncode != 0
    assert 'container = "walkers" is the name of a process' in done.stderr + done.stdout
