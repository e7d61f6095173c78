"""A Python of another processor that QEMU emulates (qemu-user), in a folder of its own.

It is made of Debian packages of that processor and of wheels from the package index: without root,
and without any change of this system. An emulated start takes 5 to 90 s, and a world runs at about
a tenth of its speed.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import distribution
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from minerva_bus import __version__
from minerva_bus.errors import MisuseError

DEBIAN_NAMES: Final[Mapping[str, str]] = {"aarch64": "arm64"}
"""Processors that can be emulated, with their names in Debian."""
EXTRAS: Final = "neighbours,record"
"""Libraries that installed worlds, and this package, need beyond those that each world needs."""
_GLIBC: Final = (17, 24, 26, 27, 28, 31, 34)
"""Versions of the C library for which wheels are built."""
_MADE: Final = "minerva-bus"
"""The file that says which version of Minerva Bus a complete folder has."""


def emulated(architecture: str, folder: Path) -> Sequence[str]:
    """The command of a Python for this processor in a folder, which is made if it is not there.

    Raises MisuseError for an unknown processor, without QEMU, for a folder of another version, and
    if it cannot be made.
    """
    if architecture not in DEBIAN_NAMES:
        known = ", ".join(DEBIAN_NAMES)
        raise MisuseError(f"--emulate {architecture}: expected one of: {known}")
    names = (f"qemu-{architecture}-static", f"qemu-{architecture}")
    qemu = next((path for name in names if (path := shutil.which(name))), None)
    if qemu is None:
        raise MisuseError(f"--emulate needs {names[0]}: apt install qemu-user-static")
    folder = folder.resolve()
    if not folder.exists():
        _make(architecture, folder)
    made = folder / _MADE
    version = made.read_text(encoding="utf-8") if made.exists() else "nothing that is complete"
    if version != __version__:
        raise MisuseError(
            f"--setup {folder}: it has {version}; expected Minerva Bus {__version__}:"
            " remove the folder, and it is made again"
        )
    variables = {
        "QEMU_LD_PREFIX": folder / "root",
        "PYTHONHOME": folder / "root" / "usr",
        "PYTHONPATH": folder / "site",
        "HOME": folder / "home",
    }
    settings = [f"{name}={path}" for name, path in variables.items()]
    return ["env", *settings, qemu, str(_python(folder))]


def _python(folder: Path) -> Path:
    return (folder / "root" / "usr" / "bin" / "python3").resolve()


def _make(architecture: str, folder: Path) -> None:
    """Make the folder; one that is not complete lacks the version."""
    for name in ("root", "site", "home", "apt/lists/partial", "apt/archives/partial"):
        (folder / name).mkdir(parents=True)
    _extract_python(DEBIAN_NAMES[architecture], folder / "apt", folder / "root")
    version = _python(folder).name.removeprefix("python")
    platforms = [f"--platform=manylinux_2_{minor}_{architecture}" for minor in _GLIBC]
    platforms += [f"--platform=manylinux2014_{architecture}"]
    with TemporaryDirectory(prefix="minerva-") as wheels:
        _pip("wheel", "--no-deps", "--wheel-dir", wheels, _requirement())
        (wheel,) = Path(wheels).glob("*.whl")
        _pip(
            "install", "--target", str(folder / "site"), "--only-binary=:all:",
            "--implementation=cp", f"--python-version={version}", *platforms,
            f"{wheel}[{EXTRAS}]",
        )  # fmt: skip
    (folder / _MADE).write_text(__version__, encoding="utf-8")


def _extract_python(debian: str, apt: Path, root: Path) -> None:
    """Extract Debian's Python for a processor, with all packages that it depends on."""
    (apt / "status").touch()  # Without installed packages, apt downloads all of them.
    settings = {
        "APT::Architecture": debian,
        "APT::Architectures": debian,
        "Dir::State::Lists": apt / "lists",
        "Dir::State::status": apt / "status",
        "Dir::Cache": apt,
        "Dir::Cache::archives": apt / "archives",
        "Debug::NoLocking": "1",
        "APT::Sandbox::User": "",
    }
    command = ["apt-get", "-qq", *(f"-o{name}={value}" for name, value in settings.items())]
    _run([*command, "update"])
    # Wheels are linked with the library of C++, which Python does not need.
    packages = ["--no-install-recommends", "python3", "libstdc++6"]
    _run([*command, "install", "--download-only", "--yes", *packages])
    for package in sorted((apt / "archives").glob("*.deb")):
        _run(["dpkg-deb", "-x", str(package), str(root)])
    if not (root / "lib").exists():  # Newer packages have all files in /usr.
        (root / "lib").symlink_to("usr/lib")


def _requirement() -> str:
    """Minerva Bus as pip installs it: the folder of an installation from one, or its version."""
    origin = distribution("minerva-bus").read_text("direct_url.json")
    described: Any = json.loads(origin) if origin else {}
    return described.get("url") or f"minerva-bus=={__version__}"


def _pip(*arguments: str) -> None:
    _run([sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments])


def _run(command: Sequence[str]) -> None:
    """Run a program. Raises MisuseError with the end of its message."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    except OSError as error:
        raise MisuseError(f"--setup: {command[0]}: {error.strerror}") from None
    if done.returncode:
        lines = (done.stderr or done.stdout).strip().splitlines() or ["it failed"]
        raise MisuseError(f"--setup: {command[0]}: {lines[-1]:.300}")
