"""The list of surviving mutants (tools/mutation.py)."""

import tomllib

from tools.mutation import INCOMPLETE, MODULES, report
from tools.survivors import ROOT, Result, Survivor, compared, only_a_cast, read_survivors, recorded

BEFORE = Survivor("a.py", "f", "- x < 1\n+ x <= 1", "x is no 1")
OTHER = Survivor("b.py", 'g"', '- "x"\n+ "\\\\XX"', "b")


def result(*survivors, waiting=0):
    verdicts = {f"k{n}": "killed" for n in range(3)}
    verdicts |= {f"s{n}": "survived" for n in range(len(survivors))}
    verdicts |= {f"w{n}": "not checked" for n in range(waiting)}
    return Result("a.py", verdicts, survivors)


def test_a_survivor_is_known_by_what_it_changes_and_needs_a_reason():
    new = Survivor("a.py", "f", "- x < 1\n+ x > 1")
    bare = Survivor("a.py", "f", BEFORE.mutation)
    assert compared(result(bare), [BEFORE, OTHER]) == ([], [])
    assert compared(result(bare, new), [BEFORE, OTHER]) == ([new], [])
    assert compared(result(bare), [bare]) == ([bare], [])
    assert compared(result(), [BEFORE, OTHER]) == ([], [BEFORE])
    assert compared(result(waiting=1), [BEFORE]) == ([], [])


def test_a_run_whose_time_was_over_is_incomplete(capsys):
    assert report(result()) == 0
    assert report(result(waiting=1)) == INCOMPLETE
    assert "incomplete" not in capsys.readouterr().out
    nothing = Result("a.py", {"w": "not checked"}, ())
    assert report(nothing) == INCOMPLETE
    assert "incomplete: all tests run once before the first mutant" in capsys.readouterr().out


def test_recording_keeps_reasons_and_other_modules(tmp_path):
    path = tmp_path / "survivors.toml"
    new = Survivor("a.py", "f", "- x < 1\n+ x > 1")
    recorded(Result("b.py", {"s": "survived"}, (OTHER,)), path)
    recorded(result(Survivor("a.py", "f", BEFORE.mutation), new), path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('reason = ""', 'reason = "x is no 1"', 1), encoding="utf-8")
    recorded(result(Survivor("a.py", "f", BEFORE.mutation)), path)
    runs, survivors = read_survivors(path)
    assert runs["a.py"] == {"mutants": 4, "killed": 3, "survived": 1}
    assert [entry.key for entry in survivors] == [BEFORE.key, OTHER.key]
    assert survivors[0].reason == "x is no 1"


def test_a_sample_says_nothing_about_mutants_outside_of_it(tmp_path):
    path = tmp_path / "survivors.toml"
    new = Survivor("a.py", "f", "- x < 1\n+ x > 1", "x is never above 1")
    sample = Result("a.py", {"k": "killed", "s": "survived"}, (new,), all=20)
    assert compared(sample, [BEFORE]) == ([new], [])
    recorded(result(BEFORE), path)
    recorded(sample, path)
    runs, survivors = read_survivors(path)
    assert runs["a.py"] == {"mutants": 20, "sampled": 2, "killed": 1, "survived": 1}
    assert [entry.key for entry in survivors] == [BEFORE.key, new.key]


def test_the_type_of_a_cast_is_not_a_fault():
    assert only_a_cast('- y = cast("A", x)\n+ y = cast("XXAXX", x)')
    assert only_a_cast('- y = cast("A", x)\n+ y = cast(None, x)')
    assert not only_a_cast('- y = cast("A", x)\n+ y = cast("A", None)')


def test_the_modules_and_their_tests_exist_and_the_list_is_whole():
    modules = tomllib.loads(MODULES.read_text(encoding="utf-8"))
    for module, entry in modules.items():
        assert (ROOT / module).exists(), module
        assert all((ROOT / test).exists() for test in entry["tests"]), module
    runs, survivors = read_survivors()
    assert set(runs) <= set(modules)
    for module, counts in runs.items():
        entries = [entry for entry in survivors if entry.module == module]
        assert len({entry.key for entry in entries}) == len(entries) <= counts["survived"]
        assert all(entry.reason for entry in entries), module
