"""Entry points and versions of packages, as Python's `importlib.metadata` reads them."""

import importlib.metadata

import pytest

from minerva_bus import entry_points
from minerva_bus.entry_points import entries, installed_version

GROUPS = ["minerva.services", "minerva.agents", "minerva.worlds", "minerva.commands"]
CACHED = (entries, entry_points._all_entries, entry_points._packages)


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder for packages that is searched first; nothing is known of it before and after."""
    monkeypatch.syspath_prepend(tmp_path)
    for each in CACHED:
        each.cache_clear()
    yield tmp_path
    for each in CACHED:
        each.cache_clear()


def package(folder, points):
    folder.mkdir()
    (folder / "METADATA").write_text(f"Name: {folder.name.partition('-')[0]}\n")
    (folder / "entry_points.txt").write_text(points)


@pytest.mark.parametrize("group", GROUPS)
def test_entries_are_those_that_python_finds(group):
    known = {
        each.name: each.value
        for each in importlib.metadata.entry_points(group=group)
        if entry_points._is_there(each.module.partition(".")[0])
    }
    assert {entry.name: entry.value for entry in entries(group).values()} == known
    assert len(known) > 0


@pytest.mark.parametrize("name", ["numpy", "eclipse-zenoh", "minerva-bus", "PyYAML"])
def test_versions_are_those_that_python_finds(name):
    assert installed_version(name) == importlib.metadata.version(name)


def test_a_package_that_is_not_installed_has_no_version():
    assert installed_version("no-such-package") is None


def test_comments_groups_and_extras(site):
    text = """
        [minerva.worlds]
        # former = gone:former.toml
        first = json:first.toml
        [other]
        first = other:thing [extra]
    """
    package(site / "probe-1.2.dist-info", text)
    assert entries("minerva.worlds")["first"].value == "json:first.toml"
    assert entries("other")["first"].value == "other:thing"
    assert entries("minerva.worlds")["first"].module == "json"
    assert installed_version("probe") == "1.2"


def test_the_first_of_two_packages_with_a_name_counts(site, tmp_path_factory, monkeypatch):
    later = tmp_path_factory.mktemp("later")
    monkeypatch.setattr("sys.path", [str(site), str(later), str(site / "absent")])
    package(site / "Probe.Tool-2.dist-info", "[group]\nname = json:dumps\n")
    package(later / "probe_tool-1.dist-info", "[group]\nname = json:loads\n")
    assert installed_version("probe-tool") == "2"
    assert entries("group")["name"].load()(3) == "3"
    assert entries("group")["name"].load().__name__ == "dumps"
