"""Machines for deploy/: an empty Debian, podman containers and a booted system, as root.

A Debian created by debootstrap replaces the Dockerfile's base image under the same name, and is the
machine of the systemd units. The machines are created once for the tests and removed afterwards;
MINERVA_MACHINES names a folder in which they are kept instead.
"""

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

from deploy.tests.deployed import DOCKERFILE

ROOT = Path(__file__).parents[3]
INCLUDED = "python3,python3-venv,ca-certificates,systemd,systemd-sysv,dbus,jq,curl"
BASE = re.search(r"^FROM (\S+)", DOCKERFILE, re.M)[1]
IMAGE = "minerva-bus:local"

CONTAINERS = """
[containers]
default_ulimits = ["nofile=20000:20000", "nproc=4096:4096"]
log_driver = "k8s-file"
[engine]
runtime = "runc"
cgroup_manager = "cgroupfs"
events_logger = "file"
"""
STORAGE = """
[storage]
driver = "overlay"
graphroot = "{place}/storage"
runroot = "{place}/running"
"""


def needs(*programs):
    """Skip unless the programs are installed and the tests run as root."""
    path = f"{os.environ.get('PATH', '')}:/usr/lib/podman:/usr/libexec/podman"
    missing = [program for program in programs if shutil.which(program, path=path) is None]
    if missing:
        pytest.skip(f"apt-get install {' '.join(missing)}: not installed")
    if os.geteuid():
        pytest.skip("takes root: it makes file systems and namespaces")


def run(*words, **rest):
    """The output of a command; AssertionError with both outputs if it fails."""
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, **rest)
    assert done.returncode == 0, f"{words}: {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="session")
def place():
    """The folder of all machines."""
    needs("debootstrap")
    kept = os.environ.get("MINERVA_MACHINES")
    folder = Path(kept or tempfile.mkdtemp(prefix="minerva-", dir="/var/tmp"))
    folder.mkdir(exist_ok=True)
    yield folder
    if not kept:
        shutil.rmtree(folder)


@pytest.fixture(scope="session")
def debian(place):
    """The root of an empty Debian with Python, systemd and access to the same package index."""
    root = place / "debian"
    if not (root / "complete").exists():
        run("debootstrap", "--variant=minbase", f"--include={INCLUDED}", "bookworm", root)
        certificates = Path("/etc/ssl/certs/ca-certificates.crt")
        for file in (Path("/etc/resolv.conf"), Path("/etc/pip.conf"), certificates):
            if file.exists():
                shutil.copy(file, root / file.relative_to("/"))
        (root / "usr/bin/python").symlink_to("python3")
        (root / "complete").touch()
    return root


class Podman:
    """podman with separate images and containers."""

    def __init__(self, place):
        (place / "containers.conf").write_text(CONTAINERS)
        (place / "storage.conf").write_text(STORAGE.format(place=place))
        self.environment = {
            **os.environ,
            "CONTAINERS_CONF": str(place / "containers.conf"),
            "CONTAINERS_STORAGE_CONF": str(place / "storage.conf"),
        }

    def __call__(self, *words, **rest):
        """The output of `podman ...`."""
        return run("podman", *words, env=self.environment, **rest)

    def said(self, container):
        """Standard output and error of a container."""
        done = subprocess.run(
            ["podman", "logs", container], env=self.environment, capture_output=True, text=True
        )
        return done.stdout + done.stderr


@pytest.fixture(scope="session")
def podman(place):
    needs("podman", "runc", "netavark", "iptables")
    own = Podman(place)
    yield own
    own("rm", "--all", "--force", "--time", "0", "--volumes")
    if "MINERVA_MACHINES" not in os.environ:
        own("rmi", "--all", "--force")


@pytest.fixture(scope="session")
def image(debian, podman, place):
    """The image of the Dockerfile, built on the empty Debian."""
    if BASE not in podman("images", "--format", "{{.Repository}}:{{.Tag}}"):
        with subprocess.Popen(
            ["tar", "-C", debian, "-cf", "-", "."], stdout=subprocess.PIPE
        ) as tar:
            podman("import", "-", f"docker.io/library/{BASE}", stdin=tar.stdout)
    podman("build", "--pull=never", "--network=host", "--file", ROOT / "deploy/docker/Dockerfile",
           "--tag", IMAGE, ROOT)  # fmt: skip
    return IMAGE
