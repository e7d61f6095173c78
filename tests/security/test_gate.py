"""Limits and roles of members, and counting of rejections."""

from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from minerva_bus.errors import KeysError
from minerva_bus.frame import messages as m
from minerva_bus.runtime.admission import (
    LOOK_EVERY,
    MAX_NAMES,
    NO_NAME,
    STRANGERS,
    Admission,
    AdmissionRules,
    Linked,
    Links,
    ListenConfig,
    Security,
)
from minerva_bus.security.credentials import Rights
from minerva_bus.wire.codec import declaration, encode
from minerva_bus.wire.keys import Keys
from minerva_bus.wire.plain import Limits, pack


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def test_a_burst_of_one_second_is_allowed_and_then_the_rate():
    clock = Clock()
    gate = AdmissionRules(Limits(messages=10, bytes=1000), clock=clock)
    assert [gate.has_room("a", 1) for _ in range(12)] == [True] * 10 + [False] * 2
    assert gate.has_room("b", 1)
    clock.now = 0.5
    assert [gate.has_room("a", 1) for _ in range(6)] == [True] * 5 + [False]
    clock.now = 100.0
    assert [gate.has_room("a", 1) for _ in range(11)] == [True] * 10 + [False]


def test_unknown_senders_share_a_smaller_limit():
    gate = AdmissionRules(Limits(messages=10, stranger_messages=3), clock=Clock())
    assert [gate.has_room(STRANGERS, 1) for _ in range(4)] == [True] * 3 + [False]
    assert "unknown senders send more than 3 messages per second" in gate.too_much(STRANGERS)
    assert gate.has_room("a", 1)


def test_bytes_count_as_well():
    clock = Clock()
    gate = AdmissionRules(Limits(messages=10, bytes=1000), clock=clock)
    assert [gate.has_room("a", size) for size in (600, 600, 300)] == [True, False, False]
    clock.now = 1.0
    assert gate.has_room("a", 900)


def test_it_is_reported_once_and_counted_each_time():
    gate = AdmissionRules(Limits(messages=1), clock=Clock())
    assert gate.has_room("a", 1)
    said = [gate.too_much("a") for _ in range(3) if not gate.has_room("a", 1)]
    assert "more than 1 messages" in said[0]
    assert said[1:] == ["", ""]
    assert gate.refused == {"a": 3}


def test_names_without_number_are_counted_as_one():
    gate = AdmissionRules()
    for number in range(MAX_NAMES + 50):
        gate.count(f"ghost-{number}")
    assert len(gate.refused) == MAX_NAMES + 1
    assert gate.refused[STRANGERS] == 50


@pytest.mark.parametrize(
    ("message", "awaited"),
    [
        (m.TickReply("a", 70_000), True),
        (m.EvolveReply("a", 1), True),
        (m.Report("a", {"x": 1}), True),
        (m.Emitted("a", ()), False),
        (m.MemberMetrics("a", {}), False),
        (m.Hello("a", 1), False),
    ],
)
def test_replies_that_a_frame_awaits_are_recognized_by_their_prefix(message, awaited):
    data = encode(message)
    assert declaration(data).awaited == awaited
    assert declaration(b"\x07\x08" + data, 2).awaited == awaited


def test_a_certificate_without_topics_is_for_none():
    rights = {"a": Rights("a", frozenset({"generator"}))}
    said = AdmissionRules(rights=lambda: rights).objection(m.Hello("a", 1, publishes=("scan",)))
    assert said == "its certificate is for no topics, not for scan (keys issue --topics)"


def test_without_certificates_all_may_do_all():
    gate = AdmissionRules()
    assert gate.objection(m.Hello("a", 1, generates=("eRain",), draws=("eShow",))) == ""
    assert gate.objection_to_question("", True, "stop") == ""
    assert gate.shut_out("a") == ""


@pytest.mark.parametrize("name", ["a$*", "*", "", "a b", "\x1b[2J", "ä", "-a", "a" * 65])
def test_a_client_without_name_is_a_stranger(name):
    said = []
    guard = Admission(Keys("w"), Limits(), ListenConfig(), lambda *line: said.append(line))
    assert guard.keeps_out(name)
    assert guard.keeps_out(name)
    assert guard.rules.refused == {STRANGERS: 2}
    assert said == [(STRANGERS, f"messages of a member are ignored: {NO_NAME}")]
    assert not guard.keeps_out("a.b-1")


class Folder:
    """Keys that change while a guard uses them."""

    def __init__(self, *rights):
        self.now, self.stamp, self.readable = {holder.name: holder for holder in rights}, 0, True

    def rights(self):
        if not self.readable:
            raise KeysError("half written")
        return dict(self.now)

    def change(self, *rights):
        self.now, self.stamp = {holder.name: holder for holder in rights}, self.stamp + 1


def guarded(folder):
    said = []
    own: Any = None  # No session is opened.
    security = Security(own, "", folder.rights, lambda: folder.stamp)
    return Admission(
        Keys("w"), Limits(), ListenConfig(security=security), lambda *line: said.append(line)
    ), said


FOX = Rights("fox", frozenset({"agent"}))
OWL = Rights("owl", frozenset({"view"}))


def test_a_deleted_certificate_counts_as_revoked_not_unknown():
    folder = Folder(FOX, OWL)
    guard, _ = guarded(folder)
    assert guard.look(LOOK_EVERY) == []
    folder.change(OWL)
    assert guard.look(1.5 * LOOK_EVERY) == []  # It checks at intervals only.
    assert guard.look(2 * LOOK_EVERY) == ["fox"]
    assert guard.rules.shut_out("fox") == "its certificate was revoked"
    assert guard.rules.objection(m.Hello("fox", 1)) == "its certificate was revoked"
    assert guard.look(3 * LOOK_EVERY) == []
    assert guard.rules.shut_out("owl") == ""


def test_temporarily_unreadable_keys_admit_no_rejected_member():
    folder = Folder(FOX, Rights("owl", frozenset({"view"}), revoked=True))
    guard, said = guarded(folder)
    folder.readable = False
    folder.change()
    assert guard.look(LOOK_EVERY) == []
    assert guard.look(2 * LOOK_EVERY) == []
    assert said == [
        ("coordinator", "cannot read the keys; the previous ones stay valid: half written")
    ]
    assert guard.rules.shut_out("owl")
    assert not guard.rules.shut_out("fox")
    folder.readable = True
    assert guard.look(3 * LOOK_EVERY) == ["fox"]


def test_values_count_as_well_and_a_message_of_too_many_is_let_through_to_be_refused():
    clock = Clock()
    gate = AdmissionRules(Limits(values=10), clock=clock)
    five, eleven = pack([0] * 4), pack([0] * 10)
    assert gate.has_values("a", eleven)
    assert not gate.has_values("a", eleven)
    assert [gate.has_values("b", five) for _ in range(4)] == [True, True, False, False]
    assert gate.has_values("c", pack(["x" * 1000]))
    clock.now = 1.0
    assert gate.has_values("b", five)


def test_hellos_count_for_one_and_for_all():
    gate = AdmissionRules(Limits(hellos=2, all_hellos=5), clock=Clock())
    assert [gate.has_hello("a") for _ in range(3)] == [True, True, False]
    assert [gate.has_hello(member) for member in "bbcd"] == [True, True, True, False]


def test_a_member_over_its_time_allowance_is_ignored_for_a_while():
    clock = Clock()
    gate = AdmissionRules(Limits(seconds=0.5), clock=clock)
    gate.spent("a", 0.75)
    assert not gate.has_room("a", 1)
    assert gate.has_room("b", 1)
    clock.now = 0.4
    assert not gate.has_room("a", 1)
    clock.now = 0.6
    assert gate.has_room("a", 1)


def test_links_without_a_certificate_are_no_links_of_a_name():
    noticed, given = [], []
    info = SimpleNamespace(
        declare_link_events_listener=lambda callback, history: given.append((callback, history))
    )
    session: Any = SimpleNamespace(info=info)
    links = Links(session, noticed.append)

    def happens(kind, name, address):
        link = SimpleNamespace(auth_identifier=name, dst=address)
        links._on_event(SimpleNamespace(kind=kind, link=link))

    happens(zenoh.SampleKind.PUT, None, "tcp/a")
    happens(zenoh.SampleKind.PUT, "fox", "tls/a")
    happens(zenoh.SampleKind.PUT, "fox", "tls/b")
    happens(zenoh.SampleKind.DELETE, None, "tls/a")
    happens(zenoh.SampleKind.DELETE, "fox", "tls/b")
    assert noticed == [Linked("fox", "tls/a"), Linked("fox", "tls/b")]
    assert (links.of("fox"), links.of("None")) == ([Linked("fox", "tls/a")], [])
    assert given[0][1] is True
