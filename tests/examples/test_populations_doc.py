"""docs/populations.md: its two forms of sheep are equivalent, and its world runs."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCUMENT = (Path(__file__).parents[2] / "docs" / "populations.md").read_text(encoding="utf-8")


def block(kind):
    (text,) = re.findall(rf"^```{kind}\n(.*?)^```$", DOCUMENT, re.M | re.S)
    return text


@pytest.fixture
def pasture(tmp_path):
    """A function that writes the document's world with one of the two forms of sheep."""

    def write(form):
        head, single = block("python one").split("class Sheep")
        sheep = block("python many") if form == "many" else f"class Sheep{single}"
        (tmp_path / "pasture.py").write_text(
            f"import numpy as np\n{head}{sheep}{block('python world')}"
        )
        (tmp_path / "pasture.toml").write_text(block("toml"))
        return tmp_path / "pasture.toml"

    return write


def run(path, *words):
    command = [sys.executable, "-m", "minerva_bus", "run", str(path), "--frames", "40", "--json"]
    done = subprocess.run([*command, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_both_forms_are_one_world_in_one_process_and_on_the_bus(pasture):
    digests = {
        (form, words): run(pasture(form), *words)["digest"]
        for form in ("one", "many")
        for words in ((), ("--in-process",))
    }
    assert len(set(digests.values())) == 1, digests
