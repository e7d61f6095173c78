"""Messages that docs/troubleshooting.md quotes are produced."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
QUOTED = re.findall(r"^\| `([^`]+)`", PAGE, re.M)


@pytest.mark.parametrize(("words", "message"), [
    (("run", "nowhere"), "there is no world 'nowhere'; installed are"),
    (("run", "nowhere.toml"), "there is no world file nowhere.toml"),
    (("run", "robot", "--frams", "3"), "robot has no option --frams; did you mean '--frames'?"),
    (("list", "--world", "nowhere"), "no world 'nowhere' runs on this machine"),
    (("attach", "svg", "--connect", "tcp/127.0.0.1:9"), "nothing listens at port 9 of 127.0.0.1"),
    (("info", "bad.mcap"), "this is no MCAP file"),
    (("run", "meadow", "--listen", "tls/127.0.0.1:0", "--keys", "none", "--frames", "1"),
     "has no authority (ca.pem); create one with minerva keys init"),
])  # fmt: skip
def test_a_mistake_gives_the_quoted_message(words, message, tmp_path):
    assert message in QUOTED
    (tmp_path / "bad.mcap").write_text("x")
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", *words],
        cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False,
        env={"PATH": "/usr/bin:/bin", "MINERVA_RUNTIME_DIR": str(tmp_path / "run")},
    )  # fmt: skip
    assert done.returncode in (1, 2)
    assert message in done.stderr
    assert "Traceback" not in done.stderr
