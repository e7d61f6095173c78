"""Hosts for tests: network namespaces on separate switches, removed at the end.

    with Network(folder) as network:
        hub, east = network.host("hub"), network.host("east")
        east.link("down")

Every host has a folder, an address on each of its networks (10.77.NETWORK.NUMBER), and a hosts file
with the names of the others. This requires root and `ip` (package iproute2).
"""

import itertools
import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
from running import Run, World, environment, eventually

_numbers = itertools.count(1)
NAMES = Path("/etc/netns")


def ip(*words):
    """Run `ip` and return its output."""
    done = subprocess.run(["ip", *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, f"ip {' '.join(map(str, words))}: {done.stderr}"
    return done.stdout


def why_not():
    """Reason why hosts are unavailable here, or an empty string."""
    if shutil.which("ip") is None:
        return "there is no ip (package iproute2)"
    if os.geteuid() != 0:
        return "network namespaces take root"
    name = f"mb{os.getpid()}t"
    try:
        ip("netns", "add", name)
        try:
            ip("-n", name, "link", "add", "probe", "type", "bridge")
            ip("-n", name, "link", "add", "one", "type", "veth", "peer", "name", "two")
        finally:
            ip("netns", "del", name)
    except AssertionError as error:
        return f"the kernel has no network namespaces with bridges: {error}"
    return ""


def why_no_lines():
    """Reason why lossy lines are unavailable here, or an empty string.

    Lines use tap devices, which nearly every kernel has, unlike netem (`tc`).
    """
    return "" if os.access("/dev/net/tun", os.R_OK | os.W_OK) else "there is no /dev/net/tun"


REASON = why_not()
needs_hosts = pytest.mark.skipif(bool(REASON), reason=REASON)


needs_lines = pytest.mark.skipif(bool(why_no_lines()), reason=why_no_lines())
LINE = Path(__file__).with_name("line.py")


class Line:
    """A slow and lossy line between a host and its switch, as a context manager.

        with Line(host, 0.05, 0.01) as line:
            eventually(lambda: line.dropped > 3, "some packets are lost")

    It delays packets by `seconds` in each direction and drops a fraction `lost` of them. The packets
    are real, so TCP detects and repairs the losses.
    """

    def __init__(self, host, seconds, lost):
        (net,) = host.addresses
        self._switch = host.network.switch(net)
        self._port, self._words = f"p{host.number}", (seconds, lost)
        self._lines = []

    def __enter__(self):
        number = self._port[1:]
        ip("-n", self._switch, "link", "add", f"bad{number}", "type", "bridge")
        ip("-n", self._switch, "link", "set", f"bad{number}", "up")
        ends = (f"a{number}", f"b{number}", *self._words, f"bad{number}", "bridge")
        self._process = subprocess.Popen(
            ["ip", "netns", "exec", self._switch, sys.executable, LINE, *map(str, ends)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._process.stdout.readline(), "the line has not begun"
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        ip("-n", self._switch, "link", "set", self._port, "master", f"bad{number}")
        return self

    def __exit__(self, *exc):
        ip("-n", self._switch, "link", "set", self._port, "master", "bridge")
        self._process.kill()
        self._process.wait()
        self._reader.join()
        self._process.stdout.close()
        ip("-n", self._switch, "link", "del", f"bad{self._port[1:]}")

    def _read(self):
        for line in self._process.stdout:
            self._lines.append(line)

    @property
    def dropped(self):
        """Number of dropped packets."""
        return len(self._lines)


class Host:
    """A machine: commands, files and links."""

    def __init__(self, network, name, number):
        self.network, self.name, self.number = network, name, number
        self.space = f"{network.space}-{name}"
        self.folder = network.folder / name
        self.folder.mkdir()
        self.inside = ("ip", "netns", "exec", self.space)
        self.addresses = {}
        ip("netns", "add", self.space)
        ip("-n", self.space, "link", "set", "lo", "up")

    @property
    def address(self):
        """Address on its first network."""
        return self.addresses[min(self.addresses)]

    def join(self, net):
        """Connect it to the switch of a network."""
        space, switch = self.space, self.network.switch(net)
        self.addresses[net] = f"10.77.{net}.{self.number}"
        port = f"p{self.number}"
        ip("link", "add", f"net{net}", "netns", space,
           "type", "veth", "peer", "name", port, "netns", switch)  # fmt: skip
        ip("-n", switch, "link", "set", port, "master", "bridge", "up")
        ip("-n", space, "address", "add", f"{self.addresses[net]}/24", "dev", f"net{net}")
        ip("-n", space, "link", "set", f"net{net}", "up")

    def link(self, state, net=None):
        """Unplug the cable ("down") or plug it in ("up")."""
        device = f"net{min(self.addresses) if net is None else net}"
        ip("-n", self.space, "link", "set", device, state)

    def move(self, number):
        """Change the address of the host."""
        (net,) = self.addresses
        old, self.addresses[net] = self.addresses[net], f"10.77.{net}.{number}"
        device = f"net{net}"
        ip("-n", self.space, "address", "del", f"{old}/24", "dev", device)
        ip("-n", self.space, "address", "add", f"{self.address}/24", "dev", device)
        self.network.tell_names()

    def vanish(self):
        """Power off: first its links go down, then all its processes are killed."""
        for net in self.addresses:
            self.link("down", net)
        self.kill()

    def kill(self):
        """Kill all its processes."""

        def dead():
            pids = [int(pid) for pid in ip("netns", "pids", self.space).split()]
            for pid in pids:
                try:
                    os.kill(pid, signal.SIGKILL)
                except ProcessLookupError:
                    continue
            return not pids

        eventually(dead, f"nothing runs on {self.name}")

    def starts(self, *words):
        """Start a `minerva` command on the host."""
        return Run(self.folder, *words, inside=self.inside)

    def runs_world(self, path, *words):
        """Start `minerva run` with a file in its folder."""
        return World(path, *words, inside=self.inside)

    def does(self, *words, **variables):
        """Run a program on the host to its end, with additional environment variables."""
        return subprocess.run(
            [*self.inside, *map(str, words)], cwd=self.folder, capture_output=True, text=True,
            stdin=subprocess.DEVNULL, env=environment(self.folder) | variables,
        )  # fmt: skip

    def program(self, *words):
        """Start a program on the host and wait for its first line of output."""
        process = subprocess.Popen(
            [*self.inside, *map(str, words)], cwd=self.folder, env=environment(self.folder),
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert process.stdout.readline(), f"{words} has ended at once"
        return process


REMOVE = """
cat >/dev/null
for space in $(ip netns list | cut -d " " -f 1 | grep "^$0[-s]"); do
    while pids=$(ip netns pids "$space") && [ -n "$pids" ]; do kill -9 $pids 2>/dev/null; done
    ip netns del "$space" && rm -rf "$1/$space"
done
"""
"""Waits for the end of its input, and removes the hosts and switches of a network."""


class Network:
    """Hosts on switches; the end of the context removes them and their processes.

    So does the end of the process, however it ends: another one waits for it.
    """

    def __init__(self, folder):
        self.folder = folder
        self.space = f"mb{os.getpid()}n{next(_numbers)}"
        self.hosts = {}
        self._switches = {}

    def __enter__(self):
        self._remover = subprocess.Popen(
            ["sh", "-c", REMOVE, self.space, NAMES], stdin=subprocess.PIPE, start_new_session=True
        )
        return self

    def __exit__(self, *exc):
        self._remover.stdin.close()
        assert self._remover.wait() == 0, "not all hosts are removed"

    def host(self, name, *nets):
        """A new host on these networks, by default on network 1."""
        host = self.hosts[name] = Host(self, name, len(self.hosts) + 1)
        for net in nets or (1,):
            host.join(net)
        self.tell_names()
        return host

    def switch(self, net):
        """The switch of a network: a bridge in a separate namespace."""
        if net not in self._switches:
            space = self._switches[net] = f"{self.space}s{net}"
            ip("netns", "add", space)
            ip("-n", space, "link", "add", "bridge", "type", "bridge")
            ip("-n", space, "link", "set", "bridge", "up")
        return self._switches[net]

    def tell_names(self):
        """Write the hosts file of each host, with the names and addresses on shared networks."""
        for host in self.hosts.values():
            lines = ["127.0.0.1 localhost"]
            for peer in self.hosts.values():
                shared = sorted(set(host.addresses) & set(peer.addresses))
                lines += [f"{peer.addresses[net]} {peer.name}" for net in shared[:1]]
            place = NAMES / host.space
            place.mkdir(parents=True, exist_ok=True)
            (place / "hosts").write_text("\n".join(lines) + "\n")
