"""The README is correct: its first claim, its program, its commands and what they need."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXTRA_OF = {
    "--record": "record",
    "--view svg": "picture",
    "--view web": "web",
    "minerva run robot": "maps",
    "minerva top": "top",
}
"""Extras that the commands of the README need."""


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.S | re.M)


def python(*words, folder):
    return subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        env={"PATH": "/usr/bin:/bin", "MINERVA_RUNTIME_DIR": str(folder / "run")},
    )


def test_it_is_one_page():
    assert len(README.splitlines()) <= 150


def test_the_same_world_in_three_layouts_prints_what_is_quoted(tmp_path):
    (block,) = blocks("console")
    command, *quoted = block.splitlines()
    assert command == "$ .venv/bin/python examples/same.py"
    done = python(ROOT / "examples" / "same.py", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len({line.split()[0] for line in lines}) == 1
    assert len(lines) == len(quoted) == 3
    for line, shown in zip(lines, quoted, strict=True):
        assert line.startswith(shown.removesuffix(", ..."))


def test_the_program_runs(tmp_path):
    (program,) = blocks("python")
    (tmp_path / "snails.py").write_text(program, encoding="utf-8")
    done = python("snails.py", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"prints {done.stdout.split()[0]} and" in README
    births = re.findall(r"\d+", done.stdout.partition("[")[2])
    assert int(births[0]) == 2
    assert len(set(births)) > 1


def test_the_commands_that_it_names_exist(tmp_path):
    commands = set(re.findall(r"^minerva (\w+)", README, re.M))
    shown = python("-m", "minerva_bus.cli.main", "--help", folder=tmp_path).stdout
    assert commands
    assert commands <= set(shown.split()), commands


def test_the_first_command_installs_what_the_others_need():
    (extras,) = re.findall(r"\.\[([\w,]+)\]", blocks("sh")[0])
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    (extras,) = re.findall(r"\[([\w,]+)\]", groups[extras][0])
    text = "\n".join(blocks("sh"))
    needed = {extra for words, extra in EXTRA_OF.items() if words in text}
    assert needed == set(EXTRA_OF.values())
    assert needed <= set(extras.split(","))
