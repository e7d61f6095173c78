"""`keys init` and `keys issue` replace no key that something else has made."""

import pytest

from minerva_bus.errors import KeysError
from minerva_certificates import AuthorityFolder, Wanted


@pytest.fixture
def keys(tmp_path):
    keys = AuthorityFolder(tmp_path / "keys")
    keys.init(["lab.example"])
    keys.issue("sensor", Wanted(("generator",)))
    return keys


@pytest.mark.parametrize("name", ["ca", "coordinator"])
def test_an_authority_does_not_replace_a_key(tmp_path, name):
    key = tmp_path / f"{name}.key"
    key.write_text("of another authority")
    with pytest.raises(KeysError, match=f"{name}.key exists, but not {name}.pem; move"):
        AuthorityFolder(tmp_path).init(["lab.example"])
    assert key.read_text() == "of another authority"
    assert [path.name for path in tmp_path.iterdir()] == [key.name]


def test_a_certificate_does_not_replace_a_key(keys):
    key = keys.folder / "anna.key"
    key.write_text("of a website")
    with pytest.raises(KeysError, match=r"anna.key exists, but not anna.pem; move"):
        keys.issue("anna", Wanted(("operator",)))
    assert key.read_text() == "of a website"
    key.unlink()
    keys.issue("anna", Wanted(("operator",)))


@pytest.mark.parametrize(
    ("name", "other"),
    [("Sensor", "sensor"), ("CA", "ca"), ("Crl", "crl"), ("Coordinator", "coordinator")],
)
def test_names_differ_not_only_in_the_case_of_letters(keys, name, other):
    """Where file systems ignore it, the new files would replace the others."""
    with pytest.raises(KeysError, match=f"{name} and {other} differ in the case of letters only"):
        keys.issue(name, Wanted(("generator",)))
    assert not (keys.folder / f"{name}.pem").exists()
