"""Regions in processes that nobody here started: certificates, and processes that take over."""

import pytest
from running import MEMBERS, Run, World, eventually, here, minerva, summary
from secured import keyed_world, secured_endpoint

from minerva_bus.log.reader import Record

REGIONS = "region-0", "region-1"


@pytest.fixture
def path(tmp_path):
    """A world with certificates for two regions, and for a generator."""
    issue = {name: {"roles": ("region",)} for name in REGIONS} | {
        "alarm": {"roles": ("generator",)}
    }
    return keyed_world(tmp_path, issue, members=MEMBERS, frames=60)[0]


def region(world, number, *words, link="tls/localhost:0", count=2):
    """The process of a region that is attached to a world."""
    name = REGIONS[number]
    return Run(
        world.folder, "attach", world.path, "--process", name, "--regions", count, "--link", link,
        "--world", world.name, "--connect", secured_endpoint(world), "--keys", f"keys/{name}.pem",
        *words,
    )  # fmt: skip


def digests(path):
    with Record(path) as record:
        return [frame.digest for frame in record.frames()]


def test_regions_that_are_killed_continue_in_other_processes(path):
    """Nothing but the reports survives, as if a machine had disappeared."""
    folder = path.parent
    words = "--rate", 20, "--regions", 2, "--coordinator-only", "--record", "run.mcap", "--json"
    words = *words, "--seed", 8  # Regions adopt it.
    with World(path, *words) as world, region(world, 1) as last, region(world, 0) as first:
        eventually(lambda: world.members() and world.frame > 5, "frames")
        last.kill()
        world.says("region-1", "is gone")
        with region(world, 1) as last:
            at = world.frame
            eventually(lambda: world.members() and world.frame > at + 5, "more frames")
            # The last region has to find the first one elsewhere.
            with region(world, 0, "--standby") as standby:
                eventually(lambda: "stands by" in standby.text, "a standby")
                first.kill()
                world.says("region-0", "is gone")
                ended = world.summary()
    alone = "--in-process", "--rate", 0, "--seed", 8, "--record", "one.mcap", "--json"
    single = here(folder, "run", path, *alone)
    assert ended["digest"] == summary(single)["digest"]
    assert digests(folder / "run.mcap") == digests(folder / "one.mcap")


def test_of_two_that_stand_by_one_takes_the_place(path):
    """The other one waits, and takes it when that has gone, too."""
    words = "--rate", 20, "--regions", 2, "--coordinator-only", "--frames", 0
    with (
        World(path, *words) as world, region(world, 1), region(world, 0) as first,
        region(world, 0, "--standby") as left, region(world, 0, "--standby") as right,
    ):  # fmt: skip
        former, standbys = first.process.pid, {each.process.pid: each for each in (left, right)}
        for each in standbys.values():
            each.says("stands by")
        eventually(lambda: world.members() and world.frame > 5, "frames")
        first.kill()
        for _ in range(2):

            def successor(former=former):
                member = world.members().get("region-0")
                present = member and member["state"] == "present" and member["pid"] != former
                return member["pid"] if present else 0

            former = eventually(successor, "a successor")
            at = world.frame
            eventually(lambda at=at: world.members() and world.frame > at + 5, "more frames")
            adopted = standbys.pop(former)
            assert all(each.process.poll() is None for each in standbys.values())
            if standbys:
                adopted.kill()


def test_a_region_with_other_settings_does_not_take_part(path):
    with World(path, "--regions", 2, "--coordinator-only") as world:
        with region(world, 1, count=3) as other:
            assert other.ends() == 2
        assert "regions: 'ById(count=2)' in the world, 'ById(count=3)' here" in other.text


def test_a_region_needs_an_endpoint_with_certificates(path):
    with World(path, "--regions", 2, "--coordinator-only") as world:
        with region(world, 1, link="tcp/localhost:0") as other:
            assert other.ends() == 2
        assert "tcp/localhost:0 has no certificates" in other.text


def test_only_regions_have_certificates_of_regions(path):
    done = minerva(path.parent, "keys", "issue", "east", "--role", "region")
    assert done.returncode == 2
    assert "certificates of regions are named region-0" in done.stderr
