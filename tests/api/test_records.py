"""Checks and records as functions."""

import pytest
from frogs import Frog, eTick, pond

from minerva_bus import MinervaError, World, check, each, record, resume, run
from minerva_bus.errors import WorldFileError


def frogs(options):
    return Frog.many("f", options["n"])


def many(**settings):
    return World(
        frogs, agents=[Frog], services=[each(eTick)], options={"n": 2}, name="many", **settings
    )


def test_a_record_of_a_world_is_resumed(tmp_path):
    a = tmp_path / "a.mcap"
    whole = run(pond(), frames=20, seed=5)
    done = record(pond(), a, frames=10, seed=5)
    assert done.frames == 10
    with pytest.raises(WorldFileError, match="name it"):
        resume(a)
    resumed = resume(a, pond(), frames=20)
    assert (resumed.frames, resumed.digest) == (20, whole.digest)
    with pytest.raises(MinervaError, match="over after 20 frames"):
        resume(a, pond())


def test_check_describes_worlds_and_files(tmp_path):
    assert check(pond()).what == "a world with 2 processes and 4 symbols"
    path = tmp_path / "pond.toml"
    pond().save(path)
    assert check(path).what == check(pond()).what
    assert "frogs:Frog" in check(path, code=False).code
    (tmp_path / "w.mnv").write_text("PWall · AFrog#a")
    assert check(tmp_path / "w.mnv").what == "a string of L(M), 2 symbols"
    assert check("robot").what.startswith("a world with ")
    with pytest.raises(MinervaError, match="no world"):
        check("rbot")
    with pytest.raises(MinervaError, match="No such file"):
        check(tmp_path / "none.mnv")
