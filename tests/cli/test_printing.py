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
from weakref import WeakSet

import pytest

import minerva_bus
from minerva_bus.cli.main import main
from minerva_bus.launch.console import printed
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
    assert here(tmp_path, "run", path, "--record", "a.mcap", "--in-process").returncode == 0
    done = minerva(tmp_path, "replay", "a.mcap", "--speed", "0", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_quiet_export_to_a_file_prints_nothing(tmp_path):
    path = write_world(tmp_path, frames=5)
    assert here(tmp_path, "run", path, "--record", "a.mcap", "--in-process").returncode == 0
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
    with printed(printed_lines.append, WeakSet()):
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
        with printed(lines.append, WeakSet()):
            print("of the run")
            in_thread(lambda: in_thread(lambda: print("of a thread of its thread")))
            inside.set()
            go_on.wait()

    running = threading.Thread(target=run)
    running.start()
    inside.wait()
    print("of another thread")
    with printed(other.append, WeakSet()):
        in_thread(lambda: print("of another run"))
    in_thread(lambda: print("of a thread of that"))
    with redirect_stdout(io.StringIO()) as own:
        print("elsewhere")
    go_on.set()
    running.join()
    print("later")
    assert lines == ["of the run", "of a thread of its thread"]
    assert other == ["of another run"]
    assert own.getvalue() == "elsewhere\n"
    assert capsys.readouterr().out == "of another thread\nof a thread of that\nlater\n"


def test_a_run_has_what_its_threads_print_in_all_its_blocks(capsys):
    lines, own, ready, end = [], WeakSet(), threading.Event(), threading.Event()

    def wait(text):
        ready.wait()
        print(text)
        end.wait()

    def started(text):
        thread = threading.Thread(target=wait, args=(text,), daemon=True)
        thread.start()
        return thread

    other, threads, begun = started("of another"), [], threading.Event()

    def starts():
        begun.wait()
        threads.append(started("of a thread of another"))

    starter = threading.Thread(target=starts)
    starter.start()
    with printed(lines.append, own):
        service = started("of a service")
        begun.set()
        starter.join()
    between = started("of one between two blocks")
    with printed(lines.append, own):
        ready.set()
        end.set()
        for thread in (other, service, between, *threads):
            thread.join()
    assert lines == ["of a service"]
    printed_elsewhere = capsys.readouterr().out.splitlines()
    assert sorted(printed_elsewhere) == [
        "of a thread of another", "of another", "of one between two blocks",
    ]  # fmt: skip


def test_concurrent_runs_leave_standard_output_as_it_was():
    before, lines = (sys.stdout, threading.Thread.start), [[] for _ in range(40)]

    def run(number):
        with printed(lines[number].append, WeakSet()):
            for _ in range(20):
                print(number)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(run, range(40)))
    assert (sys.stdout, threading.Thread.start) == before
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
