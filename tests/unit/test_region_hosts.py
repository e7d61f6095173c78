"""Hosts of regions, as operators see them by the metrics of their regions."""

import pytest

from minerva_bus.cli.attaching import FromFile, attach_member
from minerva_bus.cli.options import JoinOptions
from minerva_bus.errors import WorldFileError
from minerva_bus.frame.member import Member
from minerva_bus.frame.member_states import MemberChange
from minerva_bus.frame.members import Members
from minerva_bus.regions.beside import objection
from minerva_bus.regions.hosts import awaited, host_figures, hosts_in
from minerva_bus.world.agent import Agent


class Rabbit(Agent, symbol="ARabbit"):
    pass


def region_with(*guests):
    """The members of region 0: one of its own, one expected host, and guests."""
    members = Members(["own", "region-0.a"])
    for name in ("region-0.a", *guests):
        members.introduce(members.get(name), Member(name, None, [Rabbit]).hello())
        members.change(members.get(name), MemberChange.APPEARED)
    return members


def whole_with(figures):
    whole = Members(["region-0", "region-1"])
    whole.get("region-0").figures = figures
    return whole


def test_guests_of_a_region_are_shown_with_its_name():
    members = region_with("extra")
    whole = whole_with(host_figures(members, ["own"], "region-0"))
    shown = {host.name: host.expected for host in hosts_in(whole)}
    assert shown == {"region-0.a": True, "region-0.extra": False}


def test_guests_that_have_left_are_not_shown():
    members = region_with("extra")
    members.change(members.get("extra"), MemberChange.WENT)
    whole = whole_with(host_figures(members, ["own"], "region-0"))
    assert [host.name for host in hosts_in(whole)] == ["region-0.a"]


def test_hosts_are_awaited_instead_of_their_region():
    members = region_with("extra")
    whole = whole_with(
        host_figures(members, ["own"], "region-0", {"extra": "it will be removed in 9 s"})
    )
    whole.get("region-1").figures = {"region-0.a/waiting": True}
    assert awaited(whole, ["region-0", "region-1"]) == ["region-0.extra", "region-1"]
    assert awaited(whole, []) == []
    outlooks = {host.name: host.outlook for host in hosts_in(whole)}
    assert outlooks == {"region-0.a": "", "region-0.extra": "it will be removed in 9 s"}


def test_hosts_are_shown_with_the_number_of_their_agents():
    whole = whole_with(host_figures(region_with("extra"), ["own"], "region-0", agents={"extra": 3}))
    figures = {host.name: host.figures for host in hosts_in(whole)}
    assert figures == {"region-0.a": {}, "region-0.extra": {"agents": 3}}


def test_a_host_of_a_region_without_such_hosts_is_told_how_to_join():
    part = FromFile("region-1.rabbits-1", regions=2)
    said = r"by `hosts` in \[regions\]; with another name: --process rabbits-1 --name NAME"
    with pytest.raises(WorldFileError, match=said):
        attach_member("meadow", JoinOptions(), {}, part)


def test_a_host_that_joins_the_coordinator_is_told_where_to_join():
    hello = Member("extra", None, [Rabbit]).hello()
    said = objection(hello, makes_all_views=True)
    assert "run --coordinator-only" in said
    assert "attach --process region-0 --listen" in said
