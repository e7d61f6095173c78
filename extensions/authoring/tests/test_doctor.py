"""`minerva doctor` on a machine with all dependencies, and on one without."""

import json
import tomllib
from pathlib import Path

import pytest

from minerva_authoring import doctor
from minerva_bus.errors import BusError, MisuseError


def findings(capsys):
    code = doctor.examine(True)
    return code, {check["what"]: check for check in json.loads(capsys.readouterr().out)}


def test_this_machine_runs_worlds(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    code, checks = findings(capsys)
    assert code == 0
    assert checks["the bus"]["good"]
    assert checks["running worlds"]["note"].startswith("none; noted in ")


def test_missing_parts_are_reported_with_a_remedy(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(doctor, "find_spec", lambda name: None)
    code, checks = findings(capsys)
    assert code == 0
    assert not checks["web"]["good"]
    assert "pip install 'minerva-bus[web]'" in checks["web"]["note"]


def test_missing_extras_have_a_line_for_each_group(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    there = {"moderngl", "pygame", "gymnasium", "pettingzoo"}
    monkeypatch.setattr(doctor, "find_spec", lambda name: name if name in there else None)
    assert doctor.examine(False) == 0
    lines = capsys.readouterr().out.splitlines()
    (ml,) = [line for line in lines if line.startswith("– ml ")]
    assert "without lerobot, onnx, optuna; " in ml
    assert ml.endswith("'minerva-bus[ml]'")
    assert lines[-1].startswith("– more extras ")
    assert not [line for line in lines if line[2:].startswith(("web ", "rl "))]


def test_it_knows_all_extras_and_groups():
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    declared = project["optional-dependencies"]
    others = {"all", "audit", "dev", "docs", "mutation", "test"}
    assert set(doctor.EXTRAS) | set(doctor.GROUPS) == set(declared) - others
    for group, names in doctor.GROUPS.items():
        assert declared[group] == [f"minerva-bus[{','.join(names)}]"]


def test_without_a_bus_there_are_no_worlds(capsys, monkeypatch):
    def broken():
        raise BusError("cannot listen")

    monkeypatch.setattr(doctor, "_exchange", broken)
    assert doctor.examine(False) == 1
    assert "✗ the bus" in capsys.readouterr().out


class Check:
    """An entry point."""

    def load(self):
        return lambda source: [(source, source == "good", "as it is called")]


@pytest.mark.parametrize(("source", "code"), [("good", 0), ("bad", 1)])
def test_an_installed_check_examines_something_else(capsys, monkeypatch, source, code):
    monkeypatch.setattr(doctor, "entries", lambda group: {"robot": Check()})
    assert doctor.examine(True, {"robot": source}) == code
    assert [check["what"] for check in json.loads(capsys.readouterr().out)] == [source]
    with pytest.raises(MisuseError, match="no option --robt; installed checks are robot"):
        doctor.examine(True, {"robt": source})
