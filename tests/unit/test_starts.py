"""A command that a fork server has started sees what a new interpreter sees."""

import json
import os
import pty
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests import starts

PROBE = """
import atexit, json, os, signal, sys, threading, time
from minerva_bus import process_life
class Last:
    def __del__(self):
        os.write(2, b"destroyed, ")
last = Last()
atexit.register(os.write, 2, b"exit, ")
threading.Thread(target=lambda: time.sleep(0.05) or os.write(2, b"thread, ")).start()
print(json.dumps({
    "arguments": sys.argv[1:],
    "name": __name__,
    "main": sys.modules["__main__"].__dict__ is globals(),
    "path": sys.path,
    "folder": os.getcwd(),
    "environment": {k: v for k, v in os.environ.items() if k != "LC_CTYPE"},
    "input": sys.stdin.read(),
    "files": [(f.encoding, f.errors, f.line_buffering, f.write_through, f.name, f.mode)
              for f in (sys.stdin, sys.stdout, sys.stderr)],
    "open": sorted(os.listdir("/proc/self/fd")),
    "parent": os.getppid(),
    "leads": os.getsid(0) == os.getpid(),
    "foreground": os.isatty(0) and os.tcgetpgrp(0) == os.getpid(),
    "network": os.readlink("/proc/self/ns/net"),
    "hosts": open("/etc/hosts").read(),
    "interrupt": signal.getsignal(signal.SIGINT) is signal.default_int_handler,
    "hang up": signal.getsignal(signal.SIGHUP) is signal.SIG_IGN,
    "pipe": signal.getsignal(signal.SIGPIPE) is signal.SIG_IGN,
    "line": "minerva_bus.cli.main" in sys.modules,
    "file": __file__,
    "program": sys.argv[0],
    "began": process_life.BEGAN,
}))
print("warning", file=sys.stderr)
if "dies" in sys.argv:
    os.kill(os.getpid(), 9)
sys.exit(7)
"""
WORDS = [sys.executable, "-m", "probe"]


@pytest.fixture(autouse=True)
def forked(request, monkeypatch, tmp_path):
    """A probe instead of the command line, and for each of its starts whether it was a fork."""
    plugin = request.config.pluginmanager.getplugin("starts")
    if plugin is None:
        pytest.skip("this run starts new interpreters only")
    monkeypatch.setattr(starts, "PROGRAMS", (["-m", "probe"],))
    (tmp_path / "probe.py").write_text(PROBE)
    original, forks = plugin.fork, []

    def fork(process, arguments):
        forked = original(process, arguments)
        if any(
            "probe" in word for word in map(str, arguments["args"])
        ):  # not the start of a fork server
            forks.append(forked)
        return forked

    monkeypatch.setattr(plugin, "fork", fork)
    return forks


@pytest.fixture
def hang_ups():
    """The test may ignore hang-ups or not: a command inherits that."""
    before = signal.getsignal(signal.SIGHUP)
    yield
    signal.signal(signal.SIGHUP, before)


def result(done, before=0.0):
    result = {"code": done.returncode, "stderr": done.stderr, **json.loads(done.stdout)}
    assert result.pop("began") > before
    return result


@pytest.mark.parametrize(
    ("words", "session", "unbuffered"),
    [
        (WORDS, True, {}), (WORDS, False, {"PYTHONUNBUFFERED": "1"}),
        ([sys.executable, "probe.py"], True, {"PYTHONUNBUFFERED": "1"}),
        ([sys.executable, "./probe.py"], False, {}),
    ],
)  # fmt: skip
def test_a_fork_sees_what_a_new_interpreter_sees(
    tmp_path, monkeypatch, forked, hang_ups, words, session, unbuffered
):
    signal.signal(signal.SIGHUP, signal.SIG_IGN if session else signal.SIG_DFL)
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    options = {
        "cwd": tmp_path, "input": "ä line", "capture_output": True, "text": True,
        "env": {**kept, **unbuffered, "OTHER": "ö"}, "start_new_session": session,
    }  # fmt: skip
    for _ in range(starts.SERVERS):  # Each of them is running before the time is read.
        subprocess.run(words, **options)
    before = time.monotonic()
    fork = result(subprocess.run([*words, "a", "b c"], **options), before)
    monkeypatch.setattr(starts, "PROGRAMS", ())
    monkeypatch.setattr(starts, "SCRIPT", "no script")
    new = result(subprocess.run([*words, "a", "b c"], **options))
    assert forked == [True] * (starts.SERVERS + 1) + [False]
    assert fork == new
    assert fork["parent"] == os.getpid()
    assert fork["hang up"] is session
    assert fork["stderr"] == "warning\nthread, exit, destroyed, "


@pytest.fixture
def network():
    """The name of a network namespace with other host names."""
    name = f"minerva-starts-{os.getpid()}"
    names = Path("/etc/netns", name)
    if shutil.which("ip") is None or subprocess.run(["ip", "netns", "add", name]).returncode:
        pytest.skip("only root makes a network namespace, with ip")
    names.mkdir(parents=True)
    (names / "hosts").write_text("127.0.0.1 harbour\n")
    yield name
    subprocess.run(["ip", "netns", "del", name], check=True)
    shutil.rmtree(names)


@pytest.mark.parametrize(
    "inside",
    [[], ["nsenter", "--target", str(os.getpid()), "--net"], ["ip", "netns", "exec", "{network}"]],
    ids=["here", "nsenter", "ip"],
)
def test_a_fork_has_the_terminal_and_the_network_of_a_new_interpreter(
    request, tmp_path, monkeypatch, forked, inside
):
    if "ip" in inside:
        inside = [*inside[:-1], request.getfixturevalue("network")]
    place = [*inside, "env", "--chdir", str(tmp_path)]
    if subprocess.run([*place, "true"], stderr=subprocess.DEVNULL).returncode:
        pytest.skip("only root enters a network namespace")

    def typed():
        screen, side = pty.openpty()
        os.write(screen, b"a line\n\x04")
        done = subprocess.run(
            [*place, *WORDS, "a"], stdin=side, capture_output=True, text=True, cwd=tmp_path,
            start_new_session=True, preexec_fn=starts.take_terminal, env=dict(os.environ),
        )  # fmt: skip
        os.close(screen)
        os.close(side)
        return result(done)

    fork = typed()
    monkeypatch.setattr(starts, "PROGRAMS", ())
    new = typed()
    assert forked[0]
    assert not forked[-1]
    assert (fork["foreground"], fork["input"]) == (True, "a line\n")
    assert fork == new


@pytest.mark.parametrize("length", [1, 300])
def test_a_fork_is_listed_with_its_words(tmp_path, forked, length):
    (tmp_path / "probe.py").write_text(
        "import os, subprocess\n"
        "subprocess.run(['ps', '-ww', '-o', 'args=', '-p', str(os.getpid())], check=True)\n"
    )
    words = [*WORDS, "x" * length]
    listed = subprocess.check_output(words, cwd=tmp_path, text=True)
    assert (forked, listed.split()) == ([True], words)


def test_the_exit_of_a_fork_is_that_of_a_process(tmp_path, forked):
    said = subprocess.run([*WORDS, "dies"], cwd=tmp_path, capture_output=True, text=True)
    assert (forked, said.returncode) == ([True], -signal.SIGKILL)


def test_libraries_that_a_test_module_imports_do_not_prevent_forks(tmp_path, forked):
    """OpenCV sets LD_LIBRARY_PATH; all commands of a full run would start new interpreters."""
    cv2 = pytest.importorskip("cv2")
    assert cv2.__file__
    assert starts.interpreter_settings(os.environ) == starts.interpreter_settings(starts.INITIAL)
    subprocess.run(WORDS, cwd=tmp_path, capture_output=True, stdin=subprocess.DEVNULL)
    assert forked == [True]


def test_output_that_is_not_redirected_is_that_of_this_process(tmp_path, forked, capfd):
    subprocess.run(WORDS, cwd=tmp_path, stdin=subprocess.DEVNULL)
    out, err = capfd.readouterr()
    assert (forked, json.loads(out)["arguments"], err[:8]) == ([True], [], "warning\n")


def test_successive_forks_have_different_hash_seeds(tmp_path, forked):
    (tmp_path / "probe.py").write_text("print(hash('a text'))")
    hashes = [subprocess.check_output(WORDS, cwd=tmp_path) for _ in range(4)]
    assert forked == [True] * 4
    assert hashes[0] != hashes[1]
    assert hashes[:2] == hashes[2:]


@pytest.mark.parametrize(
    "options",
    [
        {"env": {**os.environ, "PYTHONHASHSEED": "1"}},
        {"preexec_fn": os.getpid},
        {"umask": 0o77},
        {"process_group": 0},
    ],
)
def test_a_start_that_concerns_the_interpreter_or_its_process_is_a_new_one(
    tmp_path, forked, options
):
    subprocess.run(WORDS, cwd=tmp_path, capture_output=True, **options)
    assert forked == [False]


@pytest.mark.parametrize("module", ["other", "minerva_bus", "sitecustomize"])
def test_a_fork_searches_the_folders_of_pythonpath_first(tmp_path, monkeypatch, forked, module):
    """If one of them hides an imported package, the fork becomes a new interpreter."""
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / f"{module}.py").write_text("PLACE = 'first'\n")
    (tmp_path / "probe.py").write_text(f"import sys, {module}\nprint({module}.PLACE, sys.path)\n")
    paths = os.pathsep.join(["first", "absent", str(starts.SERVER.parents[1])])
    options = {"cwd": tmp_path, "env": {**os.environ, "PYTHONPATH": paths}, "text": True}
    fork = subprocess.check_output(WORDS, **options)
    monkeypatch.setattr(starts, "PROGRAMS", ())
    new = subprocess.check_output(WORDS, **options)
    assert forked == [True, False]
    assert fork == new
    assert fork.startswith("first ")


def test_a_start_in_an_absent_folder_fails_as_usual(tmp_path, forked):
    with pytest.raises(FileNotFoundError):
        subprocess.run(WORDS, cwd=tmp_path / "absent")
    assert forked == [False]


def test_a_fork_knows_a_package_that_was_installed_after_the_start_of_the_server(tmp_path, forked):
    (tmp_path / "probe.py").write_text(
        "from minerva_bus.entry_points import entries\nprint(*entries('minerva.worlds'))\n"
    )
    before = subprocess.check_output(WORDS, cwd=tmp_path, text=True).split()
    (tmp_path / "later-1.dist-info").mkdir()
    points = "[minerva.worlds]\nlater = later:later.toml\n"
    (tmp_path / "later-1.dist-info" / "entry_points.txt").write_text(points)
    after = subprocess.check_output(WORDS, cwd=tmp_path, text=True).split()
    assert forked == [True] * 2
    assert {*after} == {*before, "later"}
    assert "robot" in before
