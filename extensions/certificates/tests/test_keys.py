"""The certificate authority: files, contents of certificates, and invalid certificates."""

import importlib
import json
import os
import ssl
import stat
import sys
from datetime import timedelta
from pathlib import Path

import pytest

from minerva_bus.errors import KeysError
from minerva_bus.security.credentials import ROLES
from minerva_certificates import AuthorityFolder, Wanted
from minerva_certificates.command import complete_roles
from minerva_certificates.key_folder import now, read_certificate
from tests.runtime.running import here, minerva


@pytest.fixture
def keys(tmp_path):
    keys = AuthorityFolder(tmp_path / "keys")
    keys.init(["lab.example", "10.1.2.3"])
    keys.issue("sensor", Wanted(("generator",), events=("eNear",), topics=("scan",)))
    return keys


def shake_hands(client, server, name):
    """A complete TLS handshake in memory; raises the error of either side."""
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    ours = client.wrap_bio(down, up, server_hostname=name)
    theirs = server.wrap_bio(up, down, server_side=True)
    waiting = [ours, theirs]
    for _ in range(10):
        for side in list(waiting):
            try:
                side.do_handshake()
                waiting.remove(side)
            except ssl.SSLWantReadError:
                continue
    theirs.write(b"x")
    ours.read(1)


def contexts(keys, client, server, crl=False):
    first, other = (
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT),
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER),
    )
    for context, name in ((first, client), (other, server)):
        context.load_verify_locations(keys.folder / "ca.pem")
        context.load_cert_chain(keys.folder / f"{name}.pem", keys.folder / f"{name}.key")
    other.verify_mode = ssl.CERT_REQUIRED
    if crl:
        other.load_verify_locations(keys.folder / "crl.pem")
        other.verify_flags |= ssl.VERIFY_CRL_CHECK_LEAF
    return first, other


def test_secrets_are_their_owner_s_alone(keys):
    assert stat.S_IMODE(keys.folder.stat().st_mode) == 0o700
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in keys.folder.iterdir()}
    assert {modes[name] for name in modes if name.endswith(".key")} == {0o600}
    assert sorted(modes) == [
        "ca.key", "ca.pem", "coordinator.key", "coordinator.pem", "crl.pem", "sensor.key",
        "sensor.pem",
    ]  # fmt: skip


def test_a_certificate_has_a_name_and_roles(keys):
    issued = keys.issued()["sensor"]
    assert issued.rights.roles == {"generator"}
    assert (issued.rights.events, issued.rights.topics) == ({"eNear"}, {"scan"})
    assert issued.rights.kinds == frozenset()
    assert issued.state(keys.now) == "valid"
    assert issued.state(keys.now + timedelta(days=366)) == "expired"
    assert issued.state(keys.now - timedelta(days=1)) == "not yet valid"
    hosts = keys.issued()["coordinator"].hosts
    assert {"lab.example", "10.1.2.3", "localhost", "127.0.0.1"} <= set(hosts)


@pytest.mark.parametrize("name", ["lab.example", "127.0.0.1", "10.1.2.3"])
def test_both_sides_of_a_tls_link_take_them(keys, name):
    shake_hands(*contexts(keys, "sensor", "coordinator"), name)


def test_the_coordinator_is_not_believed_under_another_name(keys):
    with pytest.raises(ssl.SSLCertVerificationError, match="mismatch"):
        shake_hands(*contexts(keys, "sensor", "coordinator"), "elsewhere.example")


def test_a_member_cannot_be_what_others_connect_to(keys):
    keys.issue("fox", Wanted(("agent",), hosts=("lab.example",)))
    with pytest.raises(ssl.SSLCertVerificationError, match="purpose"):
        shake_hands(*contexts(keys, "sensor", "fox"), "lab.example")


def test_the_list_of_what_was_revoked_is_one_that_others_read(keys):
    keys.issue("other", Wanted(("view",)))
    keys.revoke("sensor")
    shake_hands(*contexts(keys, "other", "coordinator", crl=True), "localhost")
    with pytest.raises(ssl.SSLError, match="revoked"):
        shake_hands(*contexts(keys, "sensor", "coordinator", crl=True), "localhost")


def test_a_revoked_name_cannot_return_with_another_certificate(keys):
    before = keys.stamp()
    assert keys.revoke("sensor").state(keys.now) == "revoked"
    assert keys.stamp() != before
    assert keys.rights()["sensor"].revoked
    assert not keys.rights()["sensor"].may("generator")
    for attempt in (
        lambda: keys.issue("sensor", Wanted(("generator",)), renew=True),
        lambda: keys.revoke("sensor"),
        lambda: keys.credentials("sensor"),
    ):
        with pytest.raises(KeysError, match="revoked"):
            attempt()
    keys.issue("another", Wanted(("generator",)))
    assert keys.rights()["sensor"].revoked


def test_an_expired_certificate_is_reported_before_any_connection(keys):
    AuthorityFolder(keys.folder, now() - timedelta(days=9)).issue("old", Wanted(("view",), days=2))
    with pytest.raises(KeysError, match=r"expired on .*minerva keys issue old --renew"):
        keys.credentials("old")
    keys.issue("old", Wanted(("view",)), renew=True)
    assert keys.credentials("old").name == "old"


def test_nothing_is_valid_for_longer_than_its_authority(tmp_path):
    keys = AuthorityFolder(tmp_path / "keys", now() - timedelta(days=9))
    keys.init(days=3)
    ends = keys.issue("sensor", Wanted(("generator",), days=30)).ends
    assert ends == keys.issued()["coordinator"].ends
    assert keys.now + timedelta(days=2) < ends < keys.now + timedelta(days=4)
    late = AuthorityFolder(tmp_path / "keys")
    assert late.issued()["sensor"].state(late.now) == "expired"
    for attempt in (lambda: late.issue("x", Wanted(("view",))), lambda: late.revoke("sensor")):
        with pytest.raises(KeysError, match=r"the authority of .* expired on .*"):
            attempt()


def test_certificates_of_another_authority_are_rejected(keys, tmp_path):
    foreign = AuthorityFolder(tmp_path / "foreign")
    foreign.init()
    foreign.issue("spy", Wanted(("operator",)))
    (keys.folder / "spy.pem").write_bytes((foreign.folder / "spy.pem").read_bytes())
    with pytest.raises(KeysError, match=r"spy\.pem was not issued by the authority beside it"):
        keys.rights()
    (keys.folder / "spy.pem").unlink()
    (keys.folder / "boss.pem").write_bytes((keys.folder / "sensor.pem").read_bytes())
    with pytest.raises(KeysError, match=r"boss\.pem is the certificate of sensor"):
        keys.rights()
    (keys.folder / "boss.pem").write_text("nothing")
    with pytest.raises(KeysError, match=r"boss\.pem is not a certificate"):
        keys.rights()
    (keys.folder / "boss.pem").unlink()
    (keys.folder / "crl.pem").write_bytes((foreign.folder / "crl.pem").read_bytes())
    with pytest.raises(KeysError, match=r"crl\.pem was not issued by the authority beside it"):
        keys.rights()
    (keys.folder / "crl.pem").unlink()
    with pytest.raises(KeysError, match=r"lacks crl\.pem"):
        keys.rights()


def test_a_member_s_folder_has_only_its_own(keys, tmp_path):
    own = tmp_path / "mine"
    own.mkdir()
    for name in ("ca.pem", "sensor.pem", "sensor.key"):
        (own / name).write_bytes((keys.folder / name).read_bytes())
    assert AuthorityFolder(own).credentials().name == "sensor"
    with pytest.raises(KeysError, match="issue and revoke where the authority was made"):
        AuthorityFolder(own).issue("other", Wanted(("view",)))
    with pytest.raises(KeysError, match="expected one; choose with"):
        keys.credentials()


def test_a_key_that_does_not_belong_to_its_certificate_is_named(keys, tmp_path):
    own = tmp_path / "mine"
    own.mkdir()
    for name in ("ca.pem", "sensor.pem"):
        (own / name).write_bytes((keys.folder / name).read_bytes())
    key = own / "sensor.key"
    key.write_bytes((keys.folder / "coordinator.key").read_bytes())
    with pytest.raises(KeysError, match=r"sensor\.key is not the key to .*sensor\.pem"):
        AuthorityFolder(own).credentials()
    key.write_text("junk")
    with pytest.raises(KeysError, match=r"sensor\.key cannot be read"):
        AuthorityFolder(own).credentials("sensor")
    key.unlink()
    os.mkfifo(key)
    with pytest.raises(KeysError, match=r"sensor\.key cannot be read: it is a pipe"):
        AuthorityFolder(own).credentials()


def test_a_renewed_certificate_keeps_all_that_is_not_overridden(keys):
    def renewed(name, *words):
        done = here(keys.folder.parent, "keys", "issue", name, "--renew", *words)
        assert done.returncode == 0, done.stderr
        return keys.issued()[name]

    before = keys.issued()
    assert renewed("sensor").rights == before["sensor"].rights
    assert keys.issued()["sensor"].serial != before["sensor"].serial
    assert renewed("coordinator").hosts == before["coordinator"].hosts
    assert "lab.example" not in renewed("coordinator", "--host", "new.example").hosts
    changed = renewed("sensor", "--role", "generator,view", "--events", "").rights
    assert (changed.roles, changed.events) == ({"generator", "view"}, frozenset())
    assert changed.topics == {"scan"}


@pytest.mark.parametrize("step", ["stage the key", "write the certificate", "move the key"])
def test_an_interrupted_renewal_leaves_a_pair_that_belongs_together(keys, monkeypatch, step):
    wanted, serial = Wanted(("generator",)), keys.issued()["sensor"].serial
    steps = iter(("stage the key", "write the certificate", "move the key"))
    replace = Path.replace

    def interrupted(path, target):
        if next(steps) == step:
            raise OSError(28, "No space left on device")
        return replace(path, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", interrupted)
        with pytest.raises(KeysError, match="No space left on device"):
            keys.issue("sensor", wanted, renew=True)
    own = AuthorityFolder(keys.folder).credentials("sensor")
    ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_cert_chain(own.certificate, own.key)
    assert (keys.issued()["sensor"].serial != serial) == (step == "move the key")
    # The remains of the interruption do not prevent another attempt.
    renewed = keys.issue("sensor", wanted, renew=True)
    ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_cert_chain(own.certificate, own.key)
    assert renewed.serial != serial
    assert not list(keys.folder.glob("*.new"))


@pytest.mark.parametrize("written", range(5))
def test_a_killed_init_leaves_nothing_that_the_next_one_keeps(tmp_path, monkeypatch, written):
    """The folder has an authority only if all of its files are complete."""
    keys, replace, left = AuthorityFolder(tmp_path / "keys"), Path.replace, iter(range(written))

    class Killed(BaseException):
        pass

    def killed(path, target):
        if next(left, None) is None:
            raise Killed
        return replace(path, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", killed)
        with pytest.raises(Killed):
            keys.init(["lab.example"])
    with pytest.raises(KeysError, match="has no authority"):
        keys.issued()
    keys.init(["lab.example"])
    shake_hands(*contexts(keys, "coordinator", "coordinator", crl=True), "lab.example")
    with pytest.raises(KeysError, match="has an authority already"):
        keys.init()


def test_an_authority_is_created_completely_or_not(tmp_path):
    for host in ("two words", "tls/a:1"):
        done = here(tmp_path, "keys", "init", "--host", host)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert not (tmp_path / "keys").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("issue", "x", "--role", "agnt"), "no role 'agnt'; did you mean 'agent'?"),
        (("issue", "x y", "--role", "agent"), "cannot name a certificate"),
        (("issue", "coordinator", "--role", "agent"), "choose another name"),
        (("issue", "x", "--role", "coordinator"), "choose another name"),
        (("issue", "ca", "--role", "agent"), "choose another name"),
        (("issue", "x", "--role", "agent", "--days", "0"), "--days must be"),
        (("issue", "x", "--role", "agent", "--kinds", "Füchse"), "plain letters"),
        (("issue", "x", "--role", "router", "--host", "tls/a:1"), "is not a host name or address"),
        (("issue", "sensor", "--role", "view"), "--renew replaces it"),
        (("issue", "x"), "--role is missing"),
        (("revoke", "sensr"), "did you mean 'sensor'?"),
        (("init",), "has an authority already"),
        (("list", "--dir", "nowhere"), "create one with minerva keys init"),
        (("router", "sensor", "world"), "is not for a router"),
    ],
)
def test_invalid_values_are_rejected_in_one_line(keys, words, said):
    before = keys.stamp()
    done = here(keys.folder.parent, "keys", *words)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert keys.stamp() == before


def test_an_empty_list_has_aligned_titles(keys):
    for file in ("sensor.pem", "coordinator.pem"):
        (keys.folder / file).unlink()
    titles = "name  roles  state  until  for"
    assert here(keys.folder.parent, "keys", "list").stdout.splitlines() == [titles]
    keys.issue("a", Wanted(("view",)))
    head, row = here(keys.folder.parent, "keys", "list").stdout.splitlines()
    assert (head.index("roles"), head.index("state")) == (row.index("view"), row.index("valid"))


def test_the_commands_do_it_all(tmp_path):
    def ask(*words):
        done = here(tmp_path, "keys", *words)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "keep keys/ca.key secret" in ask("init", "--host", "a.example,b.example")
    assert "hostA: agent, for AFox ARabbit; valid" in ask(
        "issue", "hostA", "--role", "agent", "--kinds", "AFox,ARabbit", "--days", "30"
    )
    ask("issue", "desk", "--role", "view,operator")
    ask("revoke", "hostA")
    listed = {row["name"]: row for row in json.loads(ask("list", "--json"))}
    assert listed["hostA"]["state"] == "revoked"
    assert listed["hostA"]["kinds"] == ["AFox", "ARabbit"]
    assert listed["desk"]["roles"] == ["operator", "view"]
    assert listed["coordinator"]["hosts"][:2] == ["a.example", "b.example"]
    assert "hostA" in ask("list")
    assert set(ROLES) >= {role for row in listed.values() for role in row["roles"]}


def test_a_folder_that_cannot_be_read_is_reported(tmp_path):
    """A name too long for any file serves, because root can read every folder."""
    folder = tmp_path / ("x" * 300)
    with pytest.raises(KeysError, match="cannot be read: File name too long; the process needs"):
        AuthorityFolder(folder).rights()
    done = minerva(tmp_path, "run", "robot", "--listen", "tls/127.0.0.1:0", "--keys", folder)
    assert done.returncode == 1
    assert f"{folder} cannot be read" in done.stderr
    assert "Traceback" not in done.stderr
    assert "OSError" not in done.stderr


def test_a_huge_certificate_is_refused_by_its_size(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "read_bytes", lambda path: pytest.fail("read"))
    path = tmp_path / "fox.pem"
    with path.open("wb") as file:
        file.truncate(64 << 30)
    with pytest.raises(KeysError, match=r"68.?719.?476.?736 bytes"):
        read_certificate(path)


def test_roles_are_completed():
    assert complete_roles(None, "op") == [("operator", "")]


@pytest.mark.parametrize("name", ["issuing", "key_folder"])
def test_without_its_library_the_extra_is_named(name, monkeypatch):
    monkeypatch.delitem(sys.modules, f"minerva_certificates.{name}")
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(KeysError, match=r"minerva-bus\[tls\]"):
        importlib.import_module(f"minerva_certificates.{name}")
