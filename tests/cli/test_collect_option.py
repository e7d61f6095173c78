"""`minerva run --collect NAME=EXPRESSION --into FILE`."""

import pytest

from tests.runtime.running import minerva, write_world

WRITTEN = '[collect]\ninto = "written.csv"\nwalkers = "count(AWalker)"\n'


@pytest.fixture
def path(tmp_path):
    return write_world(tmp_path, frames=3)


def run(path, *words):
    return minerva(path.parent, "run", path, "--quiet", *words)


@pytest.mark.parametrize("layout", [(), ("--in-process",)])
def test_expressions_of_the_command_line_are_collected(path, layout):
    words = ("--collect", "n=count(AWalker)", "--collect", "mean(AWalker.x)", "--into", "a.csv")
    done = run(path, *words, *layout)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    lines = (path.parent / "a.csv").read_text().splitlines()
    assert lines[0] == "frame,time,n,mean_AWalker_x"
    assert len(lines) == 1 + 4


def test_they_replace_those_of_the_world_file(path):
    path.write_text(path.read_text() + WRITTEN)
    assert run(path, "--in-process", "--collect", "AWalker.x").returncode == 0
    written = path.parent / "written.csv"
    assert written.read_text().startswith("frame,id,x\n")
    assert run(path, "--in-process", "--into", "other.csv").returncode == 0
    assert "walkers" in (path.parent / "other.csv").read_text()


@pytest.mark.parametrize(("words", "message"), [
    (["n=count(AWalkr)"], "--collect n:1:7: the world has no agent kind AWalkr; did you mean 'AWalker'?"),
    (["n=count(AWalker, y < 5)"], "--collect n:1:1: AWalker has no y"),
    (["n=cont(AWalker)"], "--collect n:1:1: there is no function cont; did you mean 'count'?"),
    (["n=count(AWalker)", "n=count(AWalker)"], "the name n is given twice"),
    (["a.csv"], "--collect takes NAME=EXPRESSION; name the file by --into a.csv"),
])  # fmt: skip
def test_a_wrong_expression_ends_the_run_before_it_starts(path, words, message):
    options = [option for word in words for option in ("--collect", word)]
    done = run(path, *options, "--into", "a.csv")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("minerva: ")
    assert message in done.stderr
    assert ("^" in done.stderr) == (":1:" in message)
    assert not (path.parent / "a.csv").exists()


def test_expressions_need_a_file_and_a_file_needs_expressions(path):
    done = run(path, "--collect", "count(AWalker)")
    assert done.returncode == 2
    assert "--collect needs a file for its tables: --into FILE.csv" in done.stderr
    done = run(path, "--into", "a.csv")
    assert done.returncode == 2
    assert "name expressions with --collect" in done.stderr
    done = run(path, "--collect", "count(AWalker)", "--into", "a.xls")
    assert done.returncode == 2
    assert "--into must end with .parquet or .csv: a.xls" in done.stderr
