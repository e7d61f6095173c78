"""Output of members becomes log lines, also for members without a process of their own."""

import contextlib
import io
import json
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from pathlib import Path

import pytest

import minerva_bus
from minerva_bus.cli.main import main
from minerva_bus.launch.console import AllThreads, printed
from tests.runtime.running import MEMBERS, here, minerva, write_world

SCREEN = MEMBERS + '\n[process.screen]\nservice = "yard:Screen"\nsaid = true\n'


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_world(tmp_path_factory.mktemp("printing"), SCREEN, frames=5)


@pytest.mark.parametrize("words", [("--json",), (), ("--quiet",)])
def test_only_the_summary_is_on_standard_output(path, words):
    done = here(path.parent, "run", path, "--in-process", *words)
    assert done.returncode == 0, done.stderr
    assert "in-process │ frame 4: 4 figures\n" in done.stderr
    assert "figures" not in done.stdout
    if "--json" in words:
        assert json.loads(done.stdout)["frames"] == 5
    else:
        assert ("the frames are over" in done.stdout) == (not words)


@pytest.mark.parametrize("layout", [(), ("--in-process",)])
def test_a_quiet_run_prints_no_summary(tmp_path, layout):
    path = write_world(tmp_path, frames=5)
    done = minerva(tmp_path, "run", path, "--quiet", *layout)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    loud = minerva(tmp_path, "run", path, *layout)
    assert "the frames are over" in loud.stdout


def test_a_quiet_replay_prints_no_summary(tmp_path):
    path = write_world(tmp_path, frames=5)
    done = here(tmp_path, "run", path, "--record", "a.mcap", "--in-process")
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "  record: a.mcap")
    done = minerva(tmp_path, "replay", "a.mcap", "--speed", "0", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_quiet_export_to_a_file_prints_nothing(tmp_path):
    path = write_world(tmp_path, frames=5)
    done = here(tmp_path, "run", path, "--record", "a.mcap", "--in-process")
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "  record: a.mcap")
    done = here(tmp_path, "export", "a.mcap", "--csv", "a.csv", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_these_lines_are_json_if_others_are(path):
    done = here(path.parent, "run", path, "--in-process", "--log-format", "json")
    assert json.loads(done.stdout)["frames"] == 5
    lines = [json.loads(line) for line in done.stderr.splitlines()]
    said = [line for line in lines if "figures" in line["message"]]
    assert len(said) > 3
    assert {(line["member"], line["level"]) for line in said} == {("in-process", "info")}


def test_lines_arrive_complete_and_the_last_one_needs_no_end():
    printed_lines = []
    with printed(printed_lines.append, AllThreads()):
        print("one")
        print("two", "three", end="")
        print(" four\nfive\n\nsix", end="")
        writers = [
            threading.Thread(target=sys.stdout.write, args=("x" * 50 + "\n",)) for _ in range(8)
        ]
        print()
        for writer in writers:
            writer.start()
        for writer in writers:
            writer.join()
        print("seven", end="", flush=True)
    assert [line for line in printed_lines if "x" not in line or "six" in line] == [
        "one", "two three four", "five", "", "six", "seven",
    ]  # fmt: skip
    assert "".join(printed_lines).count("x" * 50) == 8


def in_thread(call):
    thread = threading.Thread(target=call)
    thread.start()
    thread.join()


def test_other_threads_keep_their_output(capsys):
    lines, other, inside, go_on = [], [], threading.Event(), threading.Event()

    def run():
        with printed(lines.append):
            print("of the run")
            inside.set()
            go_on.wait()

    running = threading.Thread(target=run)
    running.start()
    inside.wait()
    print("of another thread")
    generator = threading.Thread(target=print, args=("of a generator of another run",))
    with printed(other.append, [generator]):
        print("of another run")
        generator.start()
        generator.join()
        with printed(other.append):
            print("of a run in it")
        in_thread(lambda: print("of a thread of its code"))
    with redirect_stdout(io.StringIO()) as own:
        print("elsewhere")
    go_on.set()
    running.join()
    print("later")
    assert lines == ["of the run"]
    assert other == ["of another run", "of a generator of another run", "of a run in it"]
    assert own.getvalue() == "elsewhere\n"
    assert capsys.readouterr().out == "of another thread\nof a thread of its code\nlater\n"


THREADED = """
import threading

from minerva_bus import Generator


class Threaded(Generator):
    def generate(self, tick):
        thread = threading.Thread(target=print, args=("of a thread",))
        thread.start()
        thread.join()
        return ()
"""


def test_a_run_of_the_command_has_what_all_threads_print(tmp_path):
    (tmp_path / "threaded.py").write_text(THREADED)
    member = '[process.threaded]\nservice = "threaded:Threaded"\n'
    path = write_world(tmp_path, MEMBERS + member, frames=1)
    done = here(tmp_path, "run", path, "--in-process", "--json")
    assert done.stderr.splitlines() == ["in-process │ of a thread"], done.stderr
    assert json.loads(done.stdout)["frames"] == 1


def test_runs_change_nothing_of_threads_and_leave_standard_output_as_it_was():
    before, start = sys.stdout, threading.Thread.start
    lines, seen = [[] for _ in range(40)], set()

    def run(number):
        with printed(lines[number].append):
            for _ in range(20):
                print(number)
            seen.add(threading.Thread.start)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(run, range(40)))
    assert (sys.stdout, seen) == (before, {start})
    assert lines == [[str(number)] * 20 for number in range(40)]


def test_standard_files_that_are_closed_are_opened():
    code = (
        "import os, sys\nfrom minerva_bus.__main__ import open_standard_files\n"
        "open_standard_files()\nprint('lost', flush=True)\nsys.exit(os.open('/dev/null', 0))"
    )
    words = ["bash", "-c", f'exec "{sys.executable}" -c "{code}" <&- >&-']
    done = subprocess.run(words, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (3, "", "")


def test_output_that_the_encoding_lacks_is_an_error(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["minerva", "--version"])
    monkeypatch.setattr(minerva_bus, "__version__", "1 → 2")
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), "ascii"))
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said == (
        "minerva: the output cannot be written: ascii has no '\\u2192'; set PYTHONIOENCODING=utf-8\n"
    )


def test_output_on_a_full_disk_is_an_error(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["minerva", "--version"])
    full = Path("/dev/full").open("w")  # noqa: SIM115
    monkeypatch.setattr(sys, "stdout", full)
    with pytest.raises(SystemExit) as ended:
        main()
    with contextlib.suppress(OSError):
        full.close()
    assert ended.value.code == 2
    assert "minerva: the output cannot be written: No space left" in capsys.readouterr().err


def test_code_that_has_closed_the_output_is_an_error_of_one_line(monkeypatch, capsys):
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stdout", closed)
    monkeypatch.setattr(sys, "argv", ["minerva", "version"])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert capsys.readouterr().err.endswith("code of the world has closed sys.stdout\n")
