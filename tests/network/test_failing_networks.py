"""A world on five hosts whose links and addresses fail; the string does not change.

The host of the world runs the coordinator and two generators; agents run on two hosts, a coupled
sensor and a view on one host each, and all of them authenticate with certificates. The tests share
one world and disturb it in sequence. Members reconnect automatically; only those that were killed or
have given up are restarted, as systemd does.
"""

import signal
import threading

import pytest
from hosts import Line, Network, eventually, ip, needs_hosts, needs_lines
from spread import THERE, Spread

pytestmark = needs_hosts
AWAY = "has been unreachable since"
SOON = ("--keep-trying", "4")


@pytest.fixture(scope="module")
def spread(tmp_path_factory):
    with Network(tmp_path_factory.mktemp("net")) as network:
        hosts = {name: network.host(name) for name in THERE}
        spread = Spread(network.host("hub"), hosts, options={"west": SOON})
        try:
            yield spread.begin()
        finally:
            spread.close()


def pulled_for(host, seconds):
    """Unplug the cable of a host for some seconds."""
    host.link("down")
    threading.Event().wait(seconds)
    host.link("up")


def test_a_cable_that_is_out_for_three_seconds(spread):
    pulled_for(spread.hosts["east"], 3.0)
    spread.world.says("east │", "has been waiting for it for", "it runs on another machine")
    spread.goes_on()


def test_a_cable_that_is_out_for_longer(spread):
    with spread.missing("east", "other hosts take its agents over"):
        spread.hosts["east"].link("down")
    east = spread.runs["east"]
    east.says(AWAY, "reconnecting for another 10 min")
    east.says("has been unreachable for", "tls/hub:7447: Network is unreachable")
    spread.hosts["east"].link("up")
    spread.goes_on()
    east.says("is reachable again after")


def test_a_cable_that_is_out_until_its_member_gives_up(spread):
    with spread.missing("west", "other hosts take its agents over"):
        spread.hosts["west"].link("down")
    west = spread.runs["west"]
    west.says(AWAY, "reconnecting for another 3 s")
    assert west.ends() == 0
    west.says("west: the world 'spread' has been unreachable for 4 s; giving up")
    spread.hosts["west"].link("up")
    spread.restarts("west")
    spread.goes_on()


def test_a_host_that_vanishes(spread):
    spread.options.clear()
    with spread.missing("west"):
        spread.hosts["west"].vanish()
    spread.hosts["west"].link("up")
    spread.restarts("west")
    spread.goes_on()


def test_a_host_whose_address_changes(spread):
    with spread.missing("water", "the world waits for it"):
        spread.hosts["water"].move(99)
    spread.goes_on()


def test_the_world_s_own_address_changes(spread):
    """Members resolve its name again, and dead links do not delay live ones."""
    with spread.missing("east"), spread.missing("water"), spread.missing("screen"):
        spread.hub.move(98)
    spread.goes_on()


def test_the_world_s_own_cable(spread):
    with spread.missing("east"), spread.missing("water"), spread.missing("screen"):
        spread.hub.link("down")
    spread.hub.link("up")
    spread.goes_on()


@needs_lines
def test_a_long_and_lossy_line(spread):
    """50 ms in each direction, and one packet in a hundred is lost."""
    with Line(spread.hosts["east"], 0.05, 0.01) as line:
        eventually(lambda: line.dropped > 0, "a packet is lost")
        spread.goes_on()
    spread.goes_on()


def test_ctrl_c_without_an_answer(spread):
    """A connection attempt to an unresponsive endpoint does not delay the exit."""
    screen, hub = spread.runs["screen"], spread.hub.address
    space = spread.hosts["screen"].space
    words = ("neighbour", "replace", hub, "lladdr", "02:00:00:00:00:01", "dev", "net1")
    ip("-n", space, *words, "nud", "permanent")
    said = len(screen.lines)
    eventually(lambda: any(AWAY in line for line in screen.lines[said:]), "it is missed")
    screen.kill(signal.SIGINT)
    assert screen.ends(5) == 0
    ip("-n", space, "neighbour", "delete", hub, "dev", "net1")
    spread.restarts("screen")
    spread.goes_on()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["east", "water"])
def test_a_cable_that_is_out_for_half_a_minute(spread, name, request):
    if "slow" not in request.config.getoption("markexpr"):
        pytest.skip("run on demand: pytest -m slow")
    with spread.missing(name):
        pulled_for(spread.hosts[name], 30.0)
    spread.goes_on()


def test_every_frame_is_as_if_nothing_had_happened(spread):
    assert spread.is_as_if_nothing_had_happened()
