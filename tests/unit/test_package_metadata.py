"""The wheel describes the project without broken links, with and without a base address."""

import email
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("hatchling", reason="requirements/dev.txt installs hatchling")

from package_metadata import VARIABLE, described

ROOT = Path(__file__).parents[2]
BASE = "https://example.org/minerva/raw/main"


def metadata(folder, base):
    """The metadata of a wheel built with this base address."""
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder],
        cwd=ROOT, env=environment | ({VARIABLE: base} if base else {}), capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        return email.message_from_bytes(archive.read(name))


def targets(text):
    """Targets of links and images outside code blocks."""
    return re.findall(r"\]\(([^)]+)\)", re.sub(r"^```.*?^```", "", text, flags=re.S | re.M))


@pytest.mark.parametrize("base", ["", BASE, BASE + "/"])
def test_no_link_of_the_description_is_relative(base, tmp_path):
    message = metadata(tmp_path, base)
    text = message.get_payload(decode=True).decode()
    assert message["Description-Content-Type"] == "text/markdown"
    assert "Same seed, same world" in text
    assert all(target.startswith("https://") for target in targets(text))
    inside = [target for target in targets(text) if target.startswith(BASE)]
    paths = [target.removeprefix(BASE + "/").partition("#")[0] for target in inside]
    assert [path for path in paths if not (ROOT / path).exists()] == []
    assert bool(inside) == bool(base)
    urls = dict(line.split(", ") for line in message.get_all("Project-URL", []))
    assert set(urls) == ({"Documentation", "Changelog", "Source"} if base else set())
    assert all((ROOT / url.removeprefix(BASE + "/")).exists() for url in urls.values())


def test_code_anchors_and_addresses_stay():
    text = "```sh\n[a](b)\n```\n`[c](d)` [e](https://f) [g](#h) [i](j.md)\n\n![k](l.png)\n\nend\n"
    assert described(text, "") == ("```sh\n[a](b)\n```\n`[c](d)` [e](https://f) [g](#h) i\n\nend\n")
    assert described(text, "https://x") == text.replace("(j.md)", "(https://x/j.md)").replace(
        "(l.png)", "(https://x/l.png)"
    )
