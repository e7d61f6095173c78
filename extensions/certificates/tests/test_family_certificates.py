"""A certificate for a family of names: issued only for free names, listed and revoked as one."""

import json

import pytest

from minerva_bus.errors import KeysError
from minerva_bus.launch.coordinator_process import security
from minerva_bus.launch.world_files import Access
from minerva_certificates import AuthorityFolder, Wanted
from tests.runtime.running import here

HOSTS = Wanted(("agent",), kinds=("AWalker",), family=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    keys = AuthorityFolder(tmp_path_factory.mktemp("families") / "keys")
    keys.init()
    keys.issue("hosts", HOSTS)
    keys.issue("lone-a", Wanted(("view",)))
    return keys


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("hosts-a", "--role", "view"), "hosts-a and hosts-* have names in common"),
        (("hosts-a", "--role", "view", "--family"), "hosts-a-* and hosts-* have names in common"),
        (("lone", "--role", "view", "--family"), "lone-* and lone-a have names in common"),
        (("hosts", "--role", "agent"), "--renew replaces it"),
        (("hosts", "--role", "agent", "--renew"), "hosts-* is renewed with --family"),
        (("lone-a", "--role", "view", "--renew", "--family"), "lone-a is renewed without --family"),
        (("a" * 63, "--role", "agent", "--family"), "too long for a family"),
        (("mid", "--role", "router", "--family"), "this role cannot have a family"),
        (("coordinator", "--role", "coordinator", "--family", "--renew"), "cannot have a family"),
    ],
)
def test_a_family_is_issued_only_for_free_names(folder, words, said):
    before = folder.stamp()
    done = here(folder.folder.parent, "keys", "issue", *words)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr
    assert folder.stamp() == before


def test_names_that_only_begin_alike_are_others(folder):
    assert folder.issue("hostsx", Wanted(("view",))).rights.name == "hostsx"
    renewed = folder.issue("hosts", HOSTS, renew=True)
    assert (renewed.rights.name, renewed.rights.kinds) == ("hosts-*", {"AWalker"})


def test_it_is_listed_as_a_family(folder):
    assert "hosts-*" in here(folder.folder.parent, "keys", "list").stdout
    answer = json.loads(here(folder.folder.parent, "keys", "list", "--json").stdout)
    listed = {row["name"]: row["family"] for row in answer}
    assert (listed["hosts"], listed["lone-a"], listed["coordinator"]) == (True, False, False)


def test_one_of_a_family_shows_the_family_s_certificate_under_its_own_name(folder):
    for own in (folder.credentials("hosts-b"), folder.credentials("hosts-b", "hosts")):
        assert (own.name, own.certificate.name, own.key.name) == (
            "hosts-b", "hosts.pem", "hosts.key",
        )  # fmt: skip
    assert folder.credentials(bearer="hosts").name.startswith("hosts-")
    with pytest.raises(KeysError, match=r"for the family hosts-\*, not for other"):
        folder.credentials("other", "hosts")
    with pytest.raises(KeysError, match="no certificate of 'other'"):
        folder.credentials("other")


def test_a_folder_with_an_ambiguous_name_admits_no_member(folder, tmp_path):
    keys = AuthorityFolder(tmp_path / "keys")
    keys.init()
    keys.issue("a-b", Wanted(("view",)))
    aside = (keys.folder / "a-b.pem").rename(tmp_path / "a-b.pem")
    keys.issue("a", Wanted(("agent",), family=True))
    aside.rename(keys.folder / "a-b.pem")
    with pytest.raises(KeysError, match=r"a-\* and a-b have names in common: revoke one of them"):
        keys.rights()
    keys.revoke("a-*")
    assert keys.rights()["a-*"].revoked
    with pytest.raises(KeysError, match="revoked, and its name cannot be used again"):
        keys.issue("a", Wanted(("agent",), family=True), renew=True)


def test_no_family_has_names_of_a_world_s_own_processes(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    tmp_path.chmod(0o700)
    border = Access(folder.folder)
    assert security(border, "w", ["hosts", "lone-a", "hostsy"]) is not None
    with pytest.raises(
        KeysError, match=r"hosts-\* allows others to act as hosts-2, a process that"
    ):
        security(border, "w", ["steps", "hosts-2"])
