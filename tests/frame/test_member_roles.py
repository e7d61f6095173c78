"""Queries over members: machines, columns, makers and takers of events, people, rates of views."""

from minerva_bus.frame.member_table import MemberChange, Members
from minerva_bus.frame.messages import PROTOCOL_VERSION, Hello
from minerva_bus.world.services import When


def present(*hellos, expected=()):
    """Members that have been admitted with these hellos."""
    members = Members(expected)
    for hello in hellos:
        member = members.get(hello.member)
        members.change(member, MemberChange.APPEARED)
        members.introduce(member, hello)
        members.change(member, MemberChange.ADMITTED)
    return members


def hello(name, **capabilities):
    return Hello(name, PROTOCOL_VERSION, **capabilities)


def test_each_active_member_has_a_machine():
    members = present(
        hello("east", about={"host": "m1"}), hello("west", about={"host": "m2"}), expected=["away"]
    )
    assert members.machines() == {"east": "m1", "west": "m2"}


def test_only_a_member_that_says_so_gets_events_one_by_one():
    members = present(hello("old", plain=True), hello("new"), expected=["away"])
    names = ("old", "new", "away", "~all")
    assert [members.declines_columns(name) for name in names] == [True, False, False, False]
    assert not members.knows("~all")


def test_guests_that_a_resumed_world_awaits_are_missing():
    members = present(hello("clock"), hello("passer-by"), expected=["clock", "physics"])
    members.expect("visitor")
    assert members.missing_guests() == ["visitor"]


def test_guests_and_those_who_declare_it_stand_for_people():
    named = ["keyboard", "sensor", "away"]
    members = present(hello("keyboard", people=True), hello("sensor"), hello("pub"), expected=named)
    sources = ["sensor", "pub", "away", "keyboard", "left", "~order:anna", "#"]
    assert members.standing_for_people(sources) == ("keyboard", "left", "pub")


def test_makers_send_events_by_themselves_and_takers_at_request():
    members = present(
        hello("laser", generates=("eHit",)),
        hello("orders", generates=("eHit",), orders=("eHit",)),
        hello("keyboard", generates=("eHit",), people=True),
        hello("other", generates=("eStep",), orders=("eStep",)),
        hello("guest", generates=("eHit",)),
        expected=["away", "laser", "orders", "keyboard", "other"],
    )
    assert members.makers("eHit") == ["guest", "laser"]
    assert members.takers("eHit") == ["orders"]
    members.change(members.get("orders"), MemberChange.WENT)
    assert members.takers("eHit") == []


def test_views_are_requested_at_the_rate_of_the_fastest_device():
    members = present(
        hello("fast", draws=("eShow",), when=When(rate=30.0)),
        hello("slow", draws=("eShow", "eMark"), when=When(rate=5.0)),
        hello("frames", draws=("eGrow",), when=When(every=1)),
    )
    assert members.index.rates == {"eShow": 30.0, "eMark": 5.0}
