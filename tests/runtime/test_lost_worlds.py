"""Members that lose their world: log lines, reconnection, and giving up."""

import re
import socket
import struct

from running import MEMBERS, Run, World, eventually, here, summary, write_world

from minerva_bus.runtime.joining import ReconnectMonitor
from minerva_bus.runtime.session import open_client, open_hub, sockets_to
from minerva_conformance.proxy import Proxy

ELSEWHERE = MEMBERS.replace('"yard:Steps"', '"yard:Steps"\nelsewhere = true')


def lookout(patience, obstacle="the cable is out"):
    reports, put = [], []
    monitor = ReconnectMonitor(
        "a: the world 'w'", patience, lambda: obstacle, reports.append, put.append
    )
    return monitor, reports, put


def test_a_short_interruption_is_not_reported():
    monitor, reports, _ = lookout(100.0)
    monitor.lost()
    assert monitor.away
    monitor.restored()
    assert not monitor.away
    assert monitor.check()
    assert reports == []


def test_it_reports_since_when_why_and_for_how_long_it_tries():
    monitor, reports, put = lookout(600.0)
    monitor.lost()
    assert monitor.check()
    assert reports[0].startswith("a: the world 'w' has been unreachable since ")
    assert reports[0].endswith("; reconnecting for another 10 min")
    assert monitor.check()
    (diagnosed,) = eventually(
        lambda: [call for call in put if call != monitor.check], "it has looked"
    )
    diagnosed()
    assert re.search(r"unreachable for \d\.\d s: the cable is out; reconnecting", reports[1])
    monitor.restored()
    assert re.fullmatch(r"a: the world 'w' is reachable again after \d\.\d s", reports[2])
    diagnosed()
    assert len(reports) == 3


def test_it_gives_up_in_time():
    monitor, reports, put = lookout(0.0)
    monitor.lost()
    eventually(lambda: monitor.check in put, "it is time to look")
    assert not monitor.check()
    assert len(reports) == 1
    lost = r"a: the world 'w' has been unreachable for \d\.\d s; giving up"
    assert re.fullmatch(lost, reports[0])


def test_a_link_that_dies_is_let_go():
    """Otherwise the system blocks a thread of Zenoh, and other links with it, for ten seconds.

    A link with much unsent data would stay open for a quarter of an hour.
    """
    hub, endpoint = open_hub("hub")
    with hub, open_client("one", endpoint) as client:
        sources = [str(link.src) for link in client.info.links()]
        for address in (endpoint, *sources):

            def lets_go(address=address):
                options = [
                    (
                        struct.unpack(
                            "ii", connection.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
                        )[0],
                        connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT),
                    )
                    for connection in sockets_to(address)
                ]
                return options and set(options) == {(0, 4000)}

            eventually(lets_go, f"the link to {address} is let go")


def attached(folder, path, port, *words):
    way = ("--connect", f"tcp/127.0.0.1:{port}", "--world", path.stem)
    return Run(folder, "attach", path, "--process", "steps", *way, *words)


def test_a_member_whose_name_was_taken_meanwhile_ends(tmp_path):
    path = write_world(tmp_path, ELSEWHERE, frames=0, rate=20)
    with World(path) as world:
        port = int(world.endpoint().rpartition(":")[2])
        proxy = Proxy(port, lambda: 0.0)
        with attached(tmp_path, path, proxy.port, "--keep-trying", "60") as first:
            world.runs("steps")
            proxy.close()
            first.says("has been unreachable since")
            with attached(tmp_path, path, port) as second:
                second.says("joining")
                pid = second.process.pid
                eventually(lambda: world.members()["steps"]["pid"] == pid, "another one is there")
                with Proxy(port, lambda: 0.0, at=proxy.port):
                    assert first.ends() == 2
                assert "another member has the name 'steps'" in first.text
                assert world.members()["steps"]["pid"] == pid


def test_a_restarted_world_gets_a_restarted_member(tmp_path):
    path = write_world(tmp_path, ELSEWHERE, frames=30, rate=20)
    alone = path.with_name("alone.toml")
    alone.write_text(path.read_text().replace("elsewhere = true\n", ""))
    words = ("run", alone, "--name", path.stem, "--in-process", "--json", "--rate", "0")
    undisturbed = summary(here(tmp_path, *words))
    with World(path, "--frames", "0") as world:
        port = int(world.endpoint().rpartition(":")[2])
        with attached(tmp_path, path, port, "--keep-trying", "60") as steps:
            world.runs("steps")
            eventually(lambda: world.members() and world.frame > 5, "frames go by")
            world.kill()
            steps.says("has been unreachable since")
            with World(path, "--json", "--listen", f"tcp/127.0.0.1:{port}") as again:
                steps.says("has restarted, at frame 0; joining again")
                ended = again.summary()
            assert steps.ends() == 0
    assert (ended["frames"], ended["digest"]) == (30, undisturbed["digest"])
