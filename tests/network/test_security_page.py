"""The pages on security and certificates on two machines: "Quick start" and families."""

import re
import shutil
import signal
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hosts import Network, needs_hosts
from typist import Typist

pytest.importorskip("cryptography")
pytest.importorskip("minerva_certificates")
pytestmark = needs_hosts

ROOT = Path(__file__).parents[2]
PAGES = "\n".join(
    (ROOT / page).read_text(encoding="utf-8")
    for page in ("docs/security.md", "extensions/certificates/certificates.md")
)
HERE, THERE = "lab.example", "hostA"


def blocks(title):
    """The shell blocks of a chapter, each as its commands without comments."""
    chapter = re.search(rf"^#+ {title}\n(.*?)^#", PAGES, re.S | re.M)[1]
    texts = re.findall(r"^```sh\n(.*?)^```", re.sub(r"\s+# .*", "", chapter), re.S | re.M)
    return [text.splitlines() for text in texts]


@pytest.fixture
def typist():
    """Two machines with the world's files, and a reader who types commands on them.

    The folder is not pytest's, because the path of a socket is limited to about 100 bytes.
    """
    with TemporaryDirectory() as name, Network(Path(name)) as network:
        typist = Typist(Path(name), network, (HERE, THERE))
        for host in typist.hosts.values():
            for file in (ROOT / "worlds" / "minerva_worlds" / "meadow").glob("meadow.*"):
                shutil.copy(file, host.folder)
        yield typist


def carry(typist, *names):
    """Copy files to the other machine ("by a way that you trust")."""
    source, target = (typist.hosts[name].folder / "keys" for name in (HERE, THERE))
    target.mkdir(exist_ok=True)
    for name in names:
        shutil.copy(source / name, target)


def type_all(typist, host, lines):
    for line in lines:
        done = typist.types(host, line)
        assert done is None or done.returncode == 0, f"{line}\n{done.stderr}"


def test_the_first_chapter_joins_two_machines(typist):
    here, there = blocks("Quick start")
    assert len(here) == 5
    assert len(there) == 1
    type_all(typist, HERE, here)
    carry(typist, "ca.pem", "hostA.pem", "hostA.key")
    typist.until(HERE, "minerva list", "foxes")
    type_all(typist, THERE, there)
    typist.until(HERE, "minerva list | grep hostA | grep AFox", "present")
    carry(typist, "ann.pem", "ann.key")
    asks = "minerva list --connect tls/lab.example:7447 --world meadow --keys keys/ann.pem"
    typist.until(THERE, asks, "hostA")
    orders = asks.replace("list", "pause")
    refused = typist.types(THERE, orders.replace("ann", "hostA"))
    assert refused.returncode != 0, "a host of agents gives no orders"
    assert "Traceback" not in refused.stderr
    type_all(typist, THERE, [orders, orders.replace("pause", "resume")])
    (_, _), (_, attached) = typist.stay
    attached.send_signal(signal.SIGTERM)
    assert attached.wait() == 0, typist.logs()
    typist.until(HERE, "minerva list | grep hostA", "left")
    typist.stay.pop()
    assert typist.ends() == [130], typist.logs()
    assert "Traceback" not in typist.logs()


def test_a_member_of_a_family_joins_by_its_own_name(typist):
    here, there = blocks("Families")
    type_all(typist, HERE, here)
    carry(typist, "ca.pem", "hosts.pem", "hosts.key")
    typist.until(HERE, "minerva list", "foxes")
    type_all(typist, THERE, there)
    typist.until(HERE, "minerva list | grep hosts-7d9f8b6c5-x2x7k", "present")
    assert typist.ends() == [0, 130], typist.logs()
