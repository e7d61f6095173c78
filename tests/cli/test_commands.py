"""The command line with valid and invalid input: output, exit code and no traceback."""

import json
import signal
import sys
from inspect import signature

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, given, settings
from typer.main import get_command

from minerva_bus.cli.main import app, main
from minerva_bus.entry_points import entries
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.launch.installed import SERVICES
from minerva_bus.launch.specs import find_service

ALPHABET = """
import math
from minerva_bus import *

PDot = Primitive("PDot", x=Default(Metres, 0.0))
TMove = Transformation("TMove", dist=Metres)
eStep = EventType("eStep")
eShow = EventType("eShow", visual=True)
number = 3

class Walker(Agent, symbol="AWalker"):
    x: Metres = 0.0
    name: str = ""

    @on("eStep")
    def walk(self, step, moment):
        self.x += 1

class Broken(Agent, symbol="ABroken"):
    @on("eStep")
    def walk(self, step, moment):
        raise LookupError("broken\\nin two")

class Counted(Generator, events=("eStep",)):
    def generate(self, tick):
        return (eStep(),)
    def report(self):
        return {"share": 0.5, "odd": math.nan, "text": "ä", "digest": "none"}

class Picky(Generator, events=("eStep",)):
    def __init__(self, limit: int = 1):
        if limit > 3:
            raise ValueError("limit is at most 3")

vocabulary = Vocabulary.of(PDot, TMove, eStep, eShow, Walker, Broken)

def text(options): return "PDot"
def scene(options): return PDot(1.0)
def nothing(options): return None
def foreign(options): return Primitive("PAlien")()
def wrong(options): return "PDat"
def fails(options): raise RuntimeError("no scene today")
def completes(options): return {**options, "more": 1}
def completes_not(options): return 5
"""

WORLD = """
[world]
string = "PDot · AWalker#w"
vocabulary = "alphabet:vocabulary"
frames = 3
dt = 0.1

[options]
size = 2
far = 1.5
deep = true
label = "x"

[process.walkers]
agents = "alphabet:Walker"

[process.steps]
service = "alphabet:Counted"
"""


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("home")
    (folder / "alphabet.py").write_text(ALPHABET, encoding="utf-8")
    (folder / "world.toml").write_text(WORLD, encoding="utf-8")
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))
    sys.modules.pop("alphabet", None)


@pytest.fixture
def minerva(home, monkeypatch, capsys):
    """A function that runs a command in this process: exit code, standard output and error."""
    monkeypatch.chdir(home)
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(home / "runtime"))

    def run(*words, user_code=False):
        monkeypatch.setattr(sys, "argv", ["minerva", *map(str, words)])
        capsys.readouterr()
        code, handler = 0, signal.getsignal(signal.SIGTERM)
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
        finally:
            signal.signal(signal.SIGTERM, handler)
        out, err = capsys.readouterr()
        assert user_code or "Traceback" not in err + out
        return code, out, err

    return run


def written(home, text, name="changed.toml"):
    path = home / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


# --- strings ---------------------------------------------------------------------------------

STRING = 'TMove<dist=1.5>(AWalker#w<x=2, name="a · b">(PDot<x=3>) · PDot) . AWalker#v // the end\n'


def test_a_string_is_checked(minerva, home):
    path = written(home, STRING, "scene.mnv")
    code, out, err = minerva("check", path)
    assert (code, err) == (0, "")
    assert out == f"{path}: a string of L(M), 5 symbols\n"
    code, out, _ = minerva("check", path, "--vocabulary", "alphabet:vocabulary", "--json")
    assert code == 0
    assert json.loads(out) == {
        "file": str(path), "ok": True, "what": "a string of its vocabulary, 5 symbols",
    }  # fmt: skip


@pytest.mark.parametrize("text", ["", "ε", "  // nothing\n", "\ufeffPDot"])
def test_small_strings(minerva, home, text):
    assert minerva("check", written(home, text, "scene.mnv"))[0] == 0


def test_a_string_cut_anywhere_is_a_string_or_wrong_with_a_caret(minerva, home):
    whole = 0
    for end in range(len(STRING)):
        path = written(home, STRING[:end], "cut.mnv")
        code, out, _ = minerva("check", path, "--json")
        answer = json.loads(out)
        assert code == (0 if answer["ok"] else 1)
        whole += answer["ok"]
        if not answer["ok"]:
            first, shown, caret = answer["error"].split("\n")
            line, column = answer["line"], answer["column"]
            assert first.startswith(f"{path}:{line}:{column}: ")
            assert caret.strip() == "^"
            assert answer["expected"]
            assert len(shown) < 90
    assert 2 <= whole < 40


@pytest.mark.parametrize(("text", "message"), [
    (b"\xff\xfe\x00", "not a text in UTF-8"),
    ("PDot · · PDot", "found '·'"),
    ("PDot(PDot)", "the primitive PDot has no scope"),
    ("TMove<dist=1>", "the transformation TMove needs a scope"),
    ("AWalker#w · AWalker#w", "duplicate id #w"),
    ("XDot", "a symbol of P, T or A"),
    ("PDot<x=>", "found '>'"),
    ("PDot<x=1e999>", "finite"),
    ("PDot<x=99999999999999999999>", "64 bits"),
    ('PDot<x="a>', "unterminated text"),
    ("PDot<x=99999x99999[0]>", "too large"),
    ("(" * 10_000, "found '('"),
    ("TMove(" * 10_000, "found the end"),
    ("PDot<x=" + "[" * 10_000, "nested at most"),
    ("PDot<x=" + "{PDot<x=" * 10_000, "nested at most"),
    ("\0", "found"),
])  # fmt: skip
def test_a_wrong_string(minerva, home, text, message):
    code, out, err = minerva("check", written(home, text, "wrong.mnv"))
    assert code == 1
    assert out == ""
    assert message in err
    assert len(err) < 1000


@pytest.mark.parametrize(("text", "message"), [
    ("PDat", "did you mean 'PDot'?"),
    ("AWalkr#w", "did you mean 'AWalker'?"),
    ("TMove(PDot)", "TMove needs a value for dist (real m)"),
    ("PDot<x=true>", "PDot: x must be a number in m"),
    ("PDot<x=1 s>", "x must be a number in m, not 1 s"),
    ("PDot<y=1>", "PDot has no y (it has x)"),
    ("AWalker#w<name=3>", "AWalker#w: name must be a text"),
])  # fmt: skip
def test_a_string_of_another_vocabulary(minerva, home, text, message):
    path = written(home, f"PDot ·\n  {text}", "foreign.mnv")
    assert minerva("check", path)[0] == 0
    code, _, err = minerva("check", path, "--vocabulary", "alphabet:vocabulary")
    assert code == 1
    assert err.startswith(f"{path}:2:3: ")
    assert message in err
    assert err.rstrip().split("\n")[-1].strip() == "^"


@pytest.mark.parametrize("spec", [
    "", "alphabet", "alphabet:nothing_there", "nowhere:x", "alphabet:number", ":", "a:b:c", "alphabet:",
    "alphabet:vocabulary.events",
])  # fmt: skip
def test_a_vocabulary_that_is_none(minerva, home, spec):
    code, _, err = minerva("check", written(home, "PDot", "dot.mnv"), "--vocabulary", spec)
    assert code == (0 if spec == "" else 1)
    assert bool(err) is bool(spec)


@pytest.mark.parametrize("name", [
    "nowhere.mnv", "nowhere.toml", ".", "folder.toml", "nowhere/x.mnv", "\0.mnv", "x" * 300 + ".mnv",
])  # fmt: skip
def test_a_file_that_is_none(minerva, home, name):
    (home / "folder.toml").mkdir(exist_ok=True)
    code, out, err = minerva("check", name)
    assert code in (1, 2)
    assert err.strip()
    assert out == ""


def test_a_program_is_no_string(minerva, home):
    path = written(home, "from minerva_bus import run\n", "snails.py")
    for words in ("check",), ("check", "--no-code"):
        code, out, err = minerva(*words, path)
        assert (code, out) == (1, "")
        assert "python snails.py runs it" in err


@pytest.mark.parametrize("words", [
    ("check", "\0.mnv"), ("run", "\0.toml"), ("info", "\0.mcap"), ("replay", "\0.mcap"), ("conformance", "\0"),
    ("run", "world.toml", "--in-process", "--record", "\0.mcap"), ("plot", "\0.csv"),
])  # fmt: skip
def test_no_argument_contains_a_null_character(minerva, home, words):
    code, out, err = minerva(*words)
    assert (code, out) == (2, "")
    assert err.startswith("minerva: the argument '\\x00")


# --- worlds ----------------------------------------------------------------------------------


def test_a_world_is_checked_and_run(minerva, home):
    checked = minerva("check", "world.toml")[1]
    assert checked == "world.toml: a world with 2 processes and 2 symbols\n"
    code, out, err = minerva("run", "world.toml", "--in-process", "--journal", "kept")
    assert (code, err) == (0, "world: no effect without a bus: journal\n")
    assert "world: the frames are over" in out
    assert "share: 0.50" in out


def test_json_output_is_json(minerva, home):
    """The summary omits a member's metric that JSON cannot represent."""

    def no_constants(name):
        raise AssertionError(f"{name} is no JSON")

    code, out, _ = minerva("run", "world.toml", "--in-process", "--json", "--quiet")
    assert code == 0
    answer = json.loads(out, parse_constant=no_constants)
    assert (answer["frames"], answer["share"], answer["text"]) == (3, 0.5, "ä")
    assert "odd" not in answer
    assert answer["digest"] != "none"


REPLACED = [
    ('"PDot · AWalker#w"', '"PDot · "'), ('"PDot · AWalker#w"', '""'), ('"PDot · AWalker#w"', "3"),
    ('string = "PDot · AWalker#w"', ""), ('"PDot · AWalker#w"', '"PDat"'),
    ('"PDot · AWalker#w"', '"PDot<x=${nothing}>"'), ('"PDot · AWalker#w"', '"PDot<x=${label}>"'),
    ('string = "PDot · AWalker#w"', 'scene = "alphabet:nothing"'),
    ('string = "PDot · AWalker#w"', 'scene = "alphabet:foreign"'),
    ('string = "PDot · AWalker#w"', 'scene = "alphabet:wrong"'),
    ('string = "PDot · AWalker#w"', 'scene = "alphabet:fails"'),
    ('string = "PDot · AWalker#w"', 'scene = "alphabet:number"'),
    ('string = "PDot · AWalker#w"', 'scene = "alphabet:vocabulary"'),
    ('string = "PDot · AWalker#w"', 'scene = "alphabet:Walker"'),
    ('string = "PDot · AWalker#w"', 'string = "PDot"\nscene = "alphabet:scene"'),
    ("frames = 3", "frames = 3\ndefaults = 'alphabet:fails'"),
    ("frames = 3", "frames = 3\ndefaults = 'alphabet:completes_not'"),
    ("frames = 3", "frames = 3\ndefaults = 'alphabet:number'"),
    ("frames = 3", "frames = 3\nframe = 3"), ("frames = 3", "frames = -3"),
    ("frames = 3", "frames = 3.5"), ("frames = 3", "frames = true"), ("frames = 3", 'frames = "3"'),
    ("frames = 3", "frames = 3\nseed = 1.5"), ("frames = 3", "frames = 3\nrate = -1"),
    ("frames = 3", "frames = 3\nseed = 99999999999999999999"),
    ("frames = 3", "frames = 3\nrate = nan"), ("frames = 3", "frames = 3\nrate = inf"),
    ("dt = 0.1", "dt = 0"), ("dt = 0.1", "dt = -1"), ("dt = 0.1", "dt = inf"), ("dt = 0.1", "dt = nan"),
    ("dt = 0.1", 'dt = 0.1\norder = ["eStop"]'), ("dt = 0.1", "dt = 0.1\norder = [3]"),
    ("dt = 0.1", "dt = 0.1\norder = {a = 1}"), ("dt = 0.1", 'dt = 0.1\nuntil = "eDone"'),
    ("dt = 0.1", 'dt = 0.1\nuntil = ["eStep", "eShow"]'), ("dt = 0.1", 'dt = 0.1\npolicy = "odd"'),
    ("dt = 0.1", 'dt = 0.1\nname = "a/b"'), ("dt = 0.1", 'dt = 0.1\nname = ""\nnme = 1'),
    ("dt = 0.1", 'dt = 0.1\nname = "' + "x" * 200 + '"'),
    ('"alphabet:vocabulary"', '"alphabet:number"'), ('"alphabet:vocabulary"', '"alphabet"'),
    ('"alphabet:vocabulary"', "[]"), ('"alphabet:vocabulary"', '"os:path"'),
    ("[process.walkers]", "[process.'a b']"), ("[process.walkers]", '[process."ä"]'),
    ("[process.walkers]", "[process.''] "), ("[process.walkers]", "[[process.walkers]]"),
    ("[process.walkers]", "[proces.walkers]"), ("[process.walkers]", "[bus]\nsoft = 0\n[process.w]"),
    ("[process.walkers]", "[bus]\nhard = nan\n[process.w]"),
    ("[process.walkers]", "[bus]\nlisten = 3\n[process.w]"), ("[options]", "[option]"),
    ("[process.walkers]", "[process]\nwalkers = 3\n[process.w]"), ("[world]", "world = 3\n[w]"),
    ("[options]", "options = 3\n[o]"), ("[options]", "[[options]]"),
    ('agents = "alphabet:Walker"', 'agents = "alphabet:Counted"'),
    ('agents = "alphabet:Walker"', "agents = []"), ('agents = "alphabet:Walker"', "agents = [1]"),
    ('agents = "alphabet:Walker"', 'agents = "alphabet:Walker"\nprocesses = 0'),
    ('agents = "alphabet:Walker"', 'agents = "alphabet:Walker"\nprocesses = "two"'),
    ('agents = "alphabet:Walker"', 'agents = "alphabet:Walker"\non_failure = "dance"'),
    ('agents = "alphabet:Walker"', 'agents = "alphabet:Walker"\nrestarts = -1'),
    ('agents = "alphabet:Walker"', 'agents = "alphabet:Walker"\nrestart = 1'),
    ('agents = "alphabet:Walker"', 'agents = "alphabet:Walker"\nservice = "each"'),
    ('service = "alphabet:Counted"', 'service = "alphabet:Walker"'),
    ('service = "alphabet:Counted"', 'service = "alphabet:number"'),
    ('service = "alphabet:Counted"', 'service = "alphabet:Counted"\nspeed = 3'),
    ('service = "alphabet:Counted"', 'service = "alphabet:Picky"\nlimit = "x"'),
    ('service = "alphabet:Counted"', 'service = "alphabet:Picky"\nlimit = 1.5'),
    ('service = "alphabet:Counted"', 'service = "alphabet:Picky"\nlimit = true'),
    ('service = "alphabet:Counted"', 'service = "alphabet:Picky"\nlimit = "${sise}"'),
    ('service = "alphabet:Counted"', 'service = "each"\nevent = "eNone"'),
    ('service = "alphabet:Counted"', 'service = "each"'), ('service = "alphabet:Counted"', 'service = ""'),
    ('service = "alphabet:Counted"', "command = []"), ('service = "alphabet:Counted"', "command = [1]"),
    ("size = 2", "size = "), ("size = 2", "size = 2\nsize = 3"), ("[world]", "[world"), ("dt", "\0"),
    ("dt", "\x1b[31mdt"),
]  # fmt: skip
COUNTED = 'service = "alphabet:Counted"'


def test_a_scene_that_misuses_the_library_is_shown_with_its_line(minerva, home):
    code = "from alphabet import Walker\n\n\ndef scene(options):\n    return Walker(3).string\n"
    (home / "clumsy.py").write_text(code, encoding="utf-8")
    path = written(home, WORLD.replace('string = "PDot · AWalker#w"', 'scene = "clumsy:scene"', 1))
    code, out, err = minerva("check", path)
    assert (code, out) == (1, "")
    assert f"{path}: clumsy:scene: id must be a text, not 3" in err
    assert "return Walker(3).string" in err
    assert "clumsy.py" in err
    assert len(err.splitlines()) <= 4


@pytest.mark.parametrize(("old", "new"), REPLACED)
def test_a_wrong_world_has_one_message(minerva, home, old, new):
    assert old in WORLD
    path = written(home, WORLD.replace(old, new, 1))
    code, out, err = minerva("check", path)
    assert (code, out) == (1, ""), out
    assert str(path.name) in err or "alphabet" in err or "each" in err or "${" in err
    assert len(err.rstrip().split("\n")) <= 4
    code, out, again = minerva("run", path, "--in-process")
    assert (code, out) == (2, "")
    assert err.split("\n")[0] in again
    code, out, _ = minerva("check", path, "--json")
    assert code == 1
    assert json.loads(out)["ok"] is False


EACH_STEP = 'service = "each"\nevent = "eStep"'


@pytest.mark.parametrize(("old", "new", "message"), [
    ("frames = 3", "frams = 3", "world.frams is unknown; did you mean 'frames'?"),
    ("frames = 3", 'frames = "many"', "world.frames must be a whole number"),
    ("frames = 3", "frames = -1", "world.frames must be at least 0"),
    ("frames = 3", f"frames = {10**40}", "world.frames must be at most 9223372036854775807"),
    ("frames = 3", "frames = ", ":5:10: not TOML: Invalid value; expected "),
    ("AWalker#w", "AWolker#w", "did you mean 'AWalker'?"), ("AWalker#w", "AWalker#w<y=1>", "AWalker#w has no y"),
    ("AWalker#w", "AWalker#w<x=1s>", "x must be a number in m"),
    ("AWalker#w", "TMove<dist=1>(AWalker#w", "the scope of TMove is not closed"),
    ("alphabet:vocabulary", "alphabat:vocabulary", "world.vocabulary: 'alphabat:vocabulary': there is no mod"),
    ("alphabet:vocabulary", "alphabet:vocabular", "world.vocabulary: alphabet has no vocabular"),
    (COUNTED, 'service = "eech"', ".service: no service 'eech' is installed; did"),
    ('"alphabet:Walker"', '"alphabet:Wolker"', "process.walkers.agents: alphabet has no Wolker; did"),
    ("[world]", "[wrold]", ":2: wrold is unknown; did you mean 'world'?"),
    (COUNTED, EACH_STEP.replace("event", "evnt"), "did you mean 'event'?"), (COUNTED, EACH_STEP.replace("eStep", "eStop"), "eStop"),
    ('agents = "alphabet:Walker"', "", "needs exactly one of service, agents and command"),
    ('agents = "alphabet:Walker"', 'command = ["no-such-program"]', "which is not an executable file"),
    ("[process.walkers]", "[process.coordinator]", "the process name coordinator is reserved"),
    ("[process.walkers]", "[process.people]", "the process name people is reserved: norms"),
    ("[process.walkers]", '[bus]\nlisten = "here"\n[process.walkers]', "is not an endpoint"),
])  # fmt: skip
def test_what_is_wrong_with_a_world_is_said(minerva, home, old, new, message):
    assert old in WORLD
    path = written(home, WORLD.replace(old, new))
    for words, code in (("check",), 1), (("run", "--in-process"), 2):
        exit_code, out, err = minerva(*words, path)
        assert (exit_code, out, message in err) == (code, "", True), err


def test_a_command_is_searched_where_it_runs(minerva, home, monkeypatch):
    """It works from another folder, too: it runs in the folder of the world file."""
    written(home, "#!/bin/sh\nexit 0\n", "tool").chmod(0o755)
    (home / "elsewhere").mkdir(exist_ok=True)
    monkeypatch.chdir(home / "elsewhere")
    for command, code in (("./tool", 0), ("tool", 1), ("./other", 1), ("sh", 0)):
        text = WORLD.replace('agents = "alphabet:Walker"', f'command = ["{command}"]')
        exit_code, _, err = minerva("check", written(home, text))
        assert (exit_code, "not an executable" in err) == (code, bool(code)), command


@pytest.mark.parametrize("body", [
    "raise ValueError('at import')", "def (", "import nothing_like_it", "import sys; sys.exit(0)",
    "raise SystemExit('enough')", "1/0", "from minerva_bus import Primitive; Primitive('XBad')",
    "from minerva_bus import *\nclass A(Agent, symbol='AA'):\n    x: Undefined = 1",
    "from minerva_bus import *\nclass A(Agent, symbol='AA'):\n    id: int = 1",
    "from minerva_bus import *\nvocabulary = Vocabulary.of(3)", "\0", "raise KeyboardInterrupt()",
])  # fmt: skip
def test_a_module_that_cannot_be_imported(minerva, home, body, request):
    name = f"broken_{abs(hash(body))}"
    written(home, body, f"{name}.py")
    path = written(home, WORLD.replace("alphabet:vocabulary", f"{name}:vocabulary"))
    code, out, err = minerva("check", path)
    sys.modules.pop(name, None)
    assert out == ""
    if "Keyboard" in body:
        assert code == 130
    else:
        assert code in (1, 2)
        assert name in err


def test_a_world_fails_where_its_agents_do(minerva, home):
    path = written(home, WORLD.replace("AWalker#w", "ABroken#b").replace(":Walker", ":Broken"))
    code, _, err = minerva("run", path, "--in-process", user_code=True)
    assert code == 1
    assert "Traceback" not in err
    assert "failed in frame 0: Broken" in err
    assert "of ABroken#b at eStep: LookupError: broken" in err


def test_an_option_is_set_by_its_name(minerva, home):
    path = written(home, WORLD.replace("PDot ·", "PDot<x=${size}> ·"))
    for words, code in (
        (("--size", "3"), 0), (("--size=3",), 0), (("--far", "2"), 0), (("--deep", "false"), 0),
        (("--size", "x"), 2), (("--size", "1.5"), 2), (("--far", "x"), 2), (("--deep", "1"), 2),
        (("--size",), 2), (("size", "3"), 2), (("--", "3"), 2), (("--=3",), 2), (("-s", "3"), 2),
    ):  # fmt: skip
        exit_code, _, err = minerva("run", path, "--in-process", "--quiet", *words)
        assert exit_code == code, (words, err)
        assert (code == 0) or err.startswith("minerva: ") or "Error" in err


def test_further_views_of_a_kind_get_numbers(minerva, home):
    views = [word for name in "abc" for word in ("--view", f"svg:path={name}.svg")]
    words = ("--in-process", "--quiet", "--frames", "2", "--set", "svg-2.path='d.svg'")
    code, _, err = minerva("run", "meadow", *words, *views)
    assert code == 0, err
    assert sorted(file.name for file in home.glob("*.svg")) == ["a.svg", "c.svg", "d.svg"]


def test_two_views_of_one_file_are_refused(minerva, home):
    views = ("--view", "svg", "--view", "sprites:path=./minerva.png")
    code, _, err = minerva("run", "meadow", "--in-process", "--quiet", "--frames", "2", *views)
    assert code == 2
    assert "[process.sprites]: writes minerva.png, and so does svg; choose another" in err
    assert not (home / "minerva.svg").exists()


@pytest.mark.parametrize(("words", "message"), [
    (("--foo", "1"), "changed has no option --foo"), (("--sise", "1"), "did you mean '--size'?"),
    (("--sise",), "did you mean '--size'?"), (("--size",), "--size needs a value"),
    (("--quite", "--frames", "2"), "no option --quite; did you mean '--quiet'?"),
    (("--no-sound", "--size", "1"), "changed has no option --no-sound;"),
    (("--frames", "--rate"), "expected a whole number, not '--rate'"), (("2",), "unexpected word '2'"),
    (("--set", "steps"), "expected PROCESS.KEY=VALUE"), (("--set", "stps.x=1"), "did you mean 'steps'?"),
    (("--set", "steps.speed=1"), "has no option 'speed'"), (("--set", "=1"), "PROCESS.KEY=VALUE"),
    (("--set", "walkers.processes=0"), "processes must be at least 1"),
    (("--set", f"walkers.processes={10**40}"), "processes must be at most 1000"),
    (("--view", "swg"), "did you mean 'svg'?"), (("--view", "svg:every"), "expected KEY=VALUE"),
    (("--view", "svg:evry=3"), "did you mean 'every'?"), (("--view", ""), "no view"),
    (("--view", "./mine.py:Mine"), "names a file"),
    (("--rate", "nan"), "--rate"), (("--rate", "-1"), "--rate"), (("--rate", "inf"), "--rate"),
    (("--rate", "fast"), "--rate"), (("--frames", "-1"), "--frames"), (("--frames", "x"), "--frames"),
    (("--seed", "x"), "--seed"), (("--seed", "99999999999999999999"), "seed"),
    (("--name", "a/b"), "cannot name a world"), (("--name", "x" * 100), "cannot name a world"),
    (("--name", "../x"), "cannot name a world"), (("--name", "."), "cannot name a world"),
])  # fmt: skip
def test_a_wrong_option_of_run(minerva, home, words, message):
    path = written(home, WORLD)
    code, out, err = minerva("run", path, "--in-process", *words)
    assert (code, out) == (2, ""), out
    assert message in err


@pytest.mark.parametrize(("words", "message"), [
    (("run", "nowhere.toml"), "there is no world file nowhere.toml"),
    (("run", ".."), ".. is a folder; give the world file in it, ../NAME.toml"),
    (("run", "./"), "./ is a folder; give the world file in it, ./NAME.toml"),
    (("run", "robt"), "did you mean 'robot'?"),
    (("run", "robot", "--objectiv", "x"), "did you mean '--objective'?"),
    (("run", "robot", "--objective", "kichen"), "did you mean 'kitchen'?"),
    (("run", "robot", "--robots", "many"), "--robots must be a whole number"),
    (("run", "robot", "--planner", "dijkstra"), "astar"),
    (("run", "robot", "--map", "nowhere.yaml"), "nowhere.yaml"),
    (("run", "robot", "--set", "physics.beems=3"), "did you mean 'beams'?"),
    (("list", "--world", "none"), "no world 'none' runs on this machine"),
    (("pub", "eStep", "x"), "expected data as KEY=VALUE"),
    (("attach", "alphabet:Walker"), "no world runs on this machine"),
    (("bridge", "ros2", "tcp/127.0.0.1:9", "--qos.scn", "volatile"), "did you mean 'scan'?"),
    (("attach", "terminal"), "no service 'terminal' is installed; there are the views foxglove,"),
    (("attach", "meadow"), "no service 'meadow' is installed; meadow is a world: minerva run"),
    (("run", "svg"), "no world 'svg'; svg takes part in a running world: minerva attach svg"),
    (("run", "world.toml", "--view", "terminal"),
     "no view 'terminal' is installed; there are foxglove, opengl, page, rerun, ros2_view, sound, sprites, svg, web"),
    (("run", "world.toml", "--view", "sprite"), "no view 'sprite' is installed; did you mean 'sprites'?"),
    (("attach", "alphabet:Walker", "--connect", "nonsense", "--world", "w"), "is not an endpoint"),
    (("attach", "alphabet:Walker", "--connect", "tcp/127.0.0.1:9", "--world", "w"), "no answer"),
])  # fmt: skip
def test_a_wrong_command_line(minerva, words, message):
    code, _, err = minerva(*words)
    assert (code, message in err) == (2, True), err


@pytest.mark.parametrize("words", [
    ("run", "x" * 300), ("run", "world.toml", "--label", "x" * 300, "--in-process"), ("check", "x" * 300),
    ("info", f"{'x' * 300}.mcap"), ("diff", "x" * 300, "y"), ("map", "x" * 300),
])  # fmt: skip
def test_a_name_that_is_too_long_for_a_file_is_no_failure(minerva, words):
    code, _, err = minerva(*words)
    assert code == (0 if "--label" in words else 2), err
    assert len(err.splitlines()) <= 10


@pytest.mark.parametrize("words", [
    ("rnu",), ("--foo",), ("run",), ("check",), ("check", "a", "b"), ("pub",), ("echo", "--count", "x"),
    ("list", "--foo"), ("attach",), ("stop", "a", "b"), ("version", "x"),
])  # fmt: skip
def test_wrong_words_are_reported_in_one_line(minerva, words):
    code, out, err = minerva(*words)
    assert code == 2
    assert out == ""
    [line] = err.splitlines()
    assert "--help" in line or "minerva worlds" in line


def test_help_names_what_there_is(minerva):
    code, out, _ = minerva("--help")
    assert code == 0
    for command in ("run", "check", "attach", "list", "echo", "pub", "stop", "version"):
        assert f" {command} " in out
        code, more, _ = minerva(command, "--help")
        assert code == 0
        assert f"{command} [OPTIONS]" in more
    assert "Exit codes: 0 done" in out
    assert minerva()[0] in (0, 2)


def test_version(minerva):
    code, out, _ = minerva("version")
    assert code == 0
    assert "minerva-bus" in out
    answer = json.loads(minerva("version", "--json")[1])
    assert {"minerva-bus", "protocol", "python", "eclipse-zenoh"} <= answer.keys()
    assert answer["protocol"] == PROTOCOL_VERSION


@pytest.mark.parametrize("place", ["a file", "/proc/nowhere"])
@pytest.mark.parametrize("words", [("list",), ("run", "world.toml"), ("stop",), ("pub", "eStep")])
def test_a_runtime_folder_that_cannot_be(minerva, home, monkeypatch, place, words):
    (home / "a file").touch()
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(home / place if place == "a file" else place))
    code, _, err = minerva(*words)
    nothing_runs = words == ("list",) and place != "a file"
    assert code == (0 if nothing_runs else 2)
    assert err.count("\n") <= 3
    assert err.strip()


@pytest.mark.parametrize("text", ["", "{", "[]", '{"world": 3}', "\0", "x" * 10_000])
def test_leftovers_in_the_runtime_folder_are_removed(minerva, home, text):
    folder = home / "runtime"
    folder.mkdir(exist_ok=True)
    (folder / "old.json").write_text(text)
    assert minerva("list")[:2] == (0, "")
    assert not (folder / "old.json").exists()


# --- arbitrary files -------------------------------------------------------------------------

law = settings(
    max_examples=60, deadline=None, suppress_health_check=list(HealthCheck)
)  # the fixtures hold no state between runs
VALUES = st.sampled_from([
    "3", "-1", "0.5", "nan", "inf", '""', '"x"', "true", "[]", "[1]", '["eStep"]', "{}", "{a = 1}",
    "1979-05-27", "07:32:00", '"${size}"', '"alphabet:Walker"', '"a/b"', "99999999999999999999", "",
])  # fmt: skip
LINES = WORLD.splitlines()


@law
@given(st.lists(st.tuples(st.integers(0, len(LINES) - 1), VALUES), min_size=1, max_size=3))
def test_a_world_file_with_any_values(minerva, home, changes):
    lines = list(LINES)
    for place, value in changes:
        key, equals, _ = lines[place].partition("=")
        if equals:
            lines[place] = f"{key}= {value}"
    code, _, err = minerva("check", written(home, "\n".join(lines)))
    assert code in (0, 1)
    assert bool(err) is bool(code)


@law
@given(st.lists(st.integers(0, len(LINES) - 1), min_size=1, max_size=4, unique=True))
def test_a_world_file_without_some_lines(minerva, home, places):
    text = "\n".join(line for place, line in enumerate(LINES) if place not in places)
    assert minerva("check", written(home, text))[0] in (0, 1)


@law
@given(
    st.binary(max_size=60) | st.text(max_size=60).map(str.encode), st.sampled_from(["mnv", "toml"])
)
def test_any_file(minerva, home, data, kind):
    code, _, err = minerva("check", written(home, data, f"any.{kind}"))
    assert code in (0, 1)
    assert bool(err) is bool(code)


@pytest.mark.parametrize("command", ["attach", "bridge"])
def test_no_service_has_an_option_that_is_the_command_s_own(command):
    of_command = get_command(app).commands[command].params
    own = {word for option in of_command for word in option.opts if word.startswith("--")}
    taken = {
        (name, option)
        for name in entries(SERVICES)
        for option in signature(find_service(name).__init__).parameters
        if "--" + option.replace("_", "-") in own
    }
    assert not taken
