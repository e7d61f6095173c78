"""The hosts of a network and their processes end with the test, also if that is killed."""

import subprocess
import sys
from pathlib import Path

from hosts import eventually, ip, needs_hosts

USER = """
import sys
from pathlib import Path
sys.path.append(sys.argv[1])
from hosts import Network
host = Network(Path(sys.argv[2])).__enter__().host("one")
host.program("sh", "-c", "echo begun; exec sleep 600")
print(host.space, flush=True)
input()
"""


@needs_hosts
def test_a_killed_test_leaves_no_host(tmp_path):
    words = [sys.executable, "-c", USER, Path(__file__).parent, tmp_path]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        space = process.stdout.readline().strip()
        assert ip("netns", "pids", space)
        process.kill()
    eventually(lambda: space not in ip("netns", "list"), "its host is removed")
    eventually(lambda: not Path("/etc/netns", space).exists(), "its files are removed")
