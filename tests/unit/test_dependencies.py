"""The locks of requirements/ agree with pyproject.toml; reports of tools/dependencies.py."""

import importlib.metadata
import json
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tools import dependencies
from tools.dependencies import IMAGE_EXTRAS, LOCKS, ROOT, read

FILES = ["build.txt", "dev.txt", "image.txt"]
PYTHONS = ["3.11", "3.12", "3.13"]
PROJECT = dependencies.project()["project"]


def environment(python):
    return {"python_version": python, "python_full_version": f"{python}.0", "extra": ""}


def direct(*extras):
    """The requirements of pyproject.toml with extras, including extras that those contain."""
    requirements = [Requirement(text) for text in PROJECT["dependencies"]]
    waiting = list(extras)
    while waiting:
        for text in PROJECT["optional-dependencies"][waiting.pop()]:
            requirement = Requirement(text)
            if requirement.name == "minerva-bus":
                waiting += requirement.extras
            else:
                requirements.append(requirement)
    return requirements


def applying(lock, python):
    """The versions of a lock that apply to a Python version, by name."""
    return {
        entry.name: entry.version
        for entry in read(LOCKS / lock)
        if not entry.marker
        or Requirement(f"x; {entry.marker}").marker.evaluate(environment(python))
    }


def test_the_files_are_those_of_the_tool():
    assert sorted(path.name for path in LOCKS.iterdir()) == FILES


@pytest.mark.parametrize("lock", FILES)
def test_each_version_has_hashes_and_no_line_names_an_index(lock):
    text = (LOCKS / lock).read_text()
    assert all(entry.hashes for entry in read(LOCKS / lock))
    assert not re.search(r"://|^-|--(extra-)?index|--find-links|file:", text, re.M)
    lines = r"( *#.*|[\w.-]+==\S+( ; .*)? \\|    --hash=sha256:[0-9a-f]{64}( \\)?)?"
    assert not [line for line in text.splitlines() if not re.fullmatch(lines, line)]


@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.parametrize(
    ("lock", "extras"), [("dev.txt", ["dev"]), ("image.txt", IMAGE_EXTRAS)], ids=["dev", "image"]
)
def test_a_lock_has_what_the_project_requires(lock, extras, python):
    versions = applying(lock, python)
    for requirement in direct(*extras):
        if requirement.marker is None or requirement.marker.evaluate(environment(python)):
            assert versions[canonicalize_name(requirement.name)] in requirement.specifier, (
                requirement
            )


@pytest.mark.parametrize(
    ("lock", "extras"), [("dev.txt", ["dev"]), ("image.txt", IMAGE_EXTRAS)], ids=["dev", "image"]
)
def test_a_lock_has_nothing_that_the_project_no_longer_requires(lock, extras):
    entries = read(LOCKS / lock)
    names = {canonicalize_name(requirement.name) for requirement in direct(*extras)}
    assert {e.name for e in entries if "minerva-bus (pyproject.toml)" in e.via} == names
    roots = {"minerva-bus (pyproject.toml)", "-"}
    known = {entry.name for entry in entries}
    for entry in entries:
        assert {via for via in entry.via if not via.startswith("-c ")} <= roots | known, entry.name


def test_the_builder_is_locked_and_the_tests_have_it():
    build = applying("build.txt", "3.11")
    for text in dependencies.project()["build-system"]["requires"]:
        requirement = Requirement(text)
        assert build[requirement.name] in requirement.specifier
    assert build.items() <= applying("dev.txt", "3.11").items()


@pytest.mark.parametrize("python", PYTHONS)
def test_the_image_has_the_versions_that_are_tested(python):
    assert applying("image.txt", python).items() <= applying("dev.txt", python).items()


def test_requirements_of_locked_packages_are_locked():
    """Only packages that are installed here, in the locked version, can be checked."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    locked = applying("dev.txt", python)
    compared = 0
    for name, version in locked.items():
        try:
            package = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        if package.version != version:
            continue
        for text in package.requires or ():
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate(environment(python)):
                compared += 1
                assert locked[canonicalize_name(requirement.name)] in requirement.specifier, text
    assert compared


def test_the_image_and_the_tests_install_what_is_locked():
    dockerfile = (ROOT / "deploy" / "docker" / "Dockerfile").read_text()
    for lock in ("build.txt", "image.txt"):
        assert re.search(rf"--require-hashes\s.*-r requirements/{lock}", dockerfile)
    run = (ROOT / ".ci" / "run").read_text()
    assert "\nlocked=requirements/dev.txt\n" in run
    installs = [line for line in run.splitlines() if re.search(r"install .*-r ", line)]
    assert len(installs) == 3
    hashed = re.compile(r'--require-hashes -r "\$(locked|installer)"')
    assert all(map(hashed.search, installs))


SKIPPED = {"name": "a", "skip_reason": "Dependency not found and could not be audited: a (1)"}
FINE = {"name": "b", "version": "2", "vulns": []}
BAD = {"name": "c", "version": "3", "vulns": [{"id": "PYSEC-1", "fix_versions": ["3.1"]}]}


def audited(monkeypatch, **answers):
    """The exit code for given answers of the advisory sources: packages, or an error."""

    def run(command, **_):
        answer = answers[command[command.index("--vulnerability-service") + 1]]
        if isinstance(answer, str):
            return SimpleNamespace(
                stdout="", stderr=f"Traceback (most recent call last):\n{answer}\n"
            )
        return SimpleNamespace(stdout=json.dumps({"dependencies": answer}), stderr="")

    monkeypatch.setattr(dependencies.subprocess, "run", run)
    return dependencies.print_vulnerabilities(LOCKS / "dev.txt")


def test_a_source_that_answers_is_believed(monkeypatch, capsys):
    assert audited(monkeypatch, pypi=[FINE]) == 0
    assert "Vulnerabilities known to pypi: 0" in capsys.readouterr().out


def test_a_vulnerability_is_named_with_the_version_that_has_none(monkeypatch, capsys):
    assert audited(monkeypatch, pypi=[FINE, BAD]) == 1
    assert "c 3: PYSEC-1, fixed in 3.1" in capsys.readouterr().out


def test_the_second_source_is_asked_where_the_first_cannot_be_reached(monkeypatch, capsys):
    assert audited(monkeypatch, pypi="ConnectionError: refused", osv=[FINE]) == 0
    assert "known to osv: 0" in capsys.readouterr().out


def test_no_source_means_unknown_not_none(monkeypatch, capsys):
    """pip-audit itself prints "No known vulnerabilities found" if an index has no advisories."""
    assert audited(monkeypatch, pypi=[SKIPPED, SKIPPED], osv="ConnectionError: no such host") == 2
    said = capsys.readouterr().out
    assert "Vulnerabilities: UNKNOWN. No source gives advisories for these packages" in said
    assert "reached from here" not in said
    assert "pypi: it knows none of the packages" in said
    assert "osv: ConnectionError: no such host" in said
    assert "Traceback" not in said


def test_packages_that_a_source_does_not_know_are_named(monkeypatch, capsys):
    assert audited(monkeypatch, pypi=[SKIPPED, FINE]) == 2
    assert "Not in pypi, so UNKNOWN: a" in capsys.readouterr().out


def test_the_command_reports_licences_and_unreachable_sources():
    """With an unreachable proxy, no source can be reached."""
    pytest.importorskip("pip_audit")
    pytest.importorskip("piplicenses")
    nowhere = "http://127.0.0.1:9"
    done = subprocess.run(
        [sys.executable, "-m", "tools.dependencies"], cwd=ROOT, capture_output=True, text=True,
        env={**os.environ, "HTTPS_PROXY": nowhere, "https_proxy": nowhere, "NO_PROXY": ""},
    )  # fmt: skip
    assert done.returncode == 2
    assert re.search(r"^MIT:\n.*\bpymunk\*", done.stdout, re.M)
    assert "No source gives advisories for these packages:\n    pypi: " in done.stdout
    assert "Traceback" not in done.stdout + done.stderr


def test_a_tool_that_is_missing_is_named(monkeypatch, capsys):
    monkeypatch.setattr(dependencies.importlib.util, "find_spec", lambda name: None)
    assert dependencies.main(["lock"]) == 2
    assert "uv not installed: pip install -e '.[audit]'" in capsys.readouterr().err
