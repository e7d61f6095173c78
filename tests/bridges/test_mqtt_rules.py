"""The mapping from messages to events, and rules that are rejected before the start."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import (
    Cells,
    Default,
    EventType,
    Metres,
    MinervaError,
    Primitive,
    Vocabulary,
    WorldInfo,
)
from minerva_services.bridges.mqtt import Mqtt
from minerva_services.bridges.mqtt.connection import Broker, Login, MqttMessage, MqttOutbox
from minerva_services.bridges.mqtt.rules import EventRule, InvalidPayload, Pattern, rules_of
from minerva_services.bridges.mqtt.service import RateLimiter

eAir = EventType("eAir", celsius=float, room=Default(str, "?"))
eDoor = EventType("eDoor", open=bool)
eLevel = EventType("eLevel", depth=Metres)
eText = EventType("eText", words=str)
eRing = EventType("eRing")
eCount = EventType("eCount", count=int)
ePath = EventType("ePath", points=tuple[float, ...])
eMap = EventType("eMap", cells=Cells)
PLamp = Primitive("PLamp", on=bool)
VOCABULARY = Vocabulary.of(eAir, eDoor, eLevel, eText, eRing, eCount, ePath, eMap, PLamp)


def making(pattern, rule):
    (read,) = rules_of({pattern: rule}, 0)
    return EventRule(read, VOCABULARY, VOCABULARY.events[read.event])


def made(pattern, rule, topic, payload, noted=None):
    """The event of a message; `noted` receives the metrics with their reasons."""
    data = payload if isinstance(payload, bytes) else payload.encode()
    noted = {} if noted is None else noted
    return making(pattern, rule)(topic, data, noted.__setitem__)


@pytest.mark.parametrize(
    ("pattern", "rule", "topic", "payload", "event"),
    [
        ("t", "eAir", "t", "21.5", eAir(21.5)),
        ("t", "eAir", "t", '{"celsius": 21.5, "humidity": 40}', eAir(21.5)),
        ("t", "eAir", "t", '{"celsius": "21.5"}', eAir(21.5)),
        ("{room}/t", "eAir", "bath/t", "21", eAir(21.0, "bath")),
        ("{room}/t", "eAir", "bath/t", '{"celsius": 3, "room": "x"}', eAir(3.0, "bath")),
        ("t", "eAir", "t", '{"celsius": 3, "room": "x"}', eAir(3.0, "x")),
        ("a/+/#", {"event": "eAir", "receivers": ["r-{1}"]}, "a/b/c/d", "1", eAir(1.0, receivers=["r-b"])),
        ("a/#", "eRing", "a", "anything", eRing()),
        ("#", "eRing", "a/b", "", eRing()),
        ("t", {"event": "eAir", "data": {"celsius": "s.0.t"}}, "t", '{"s": [{"t": 4}]}', eAir(4.0)),
        ("t", {"event": "eAir", "data": {"celsius": {"scale": 0.1, "offset": 1}}}, "t", "215", eAir(22.5)),
        ("t", {"event": "eLevel", "data": {"depth": {"unit": "cm"}}}, "t", "57", eLevel(0.57)),
        ("t", {"event": "eLevel", "data": {"depth": {"from": "d", "unit": "mm"}}}, "t", '{"d": 57}', eLevel(0.057)),
        ("t", "eDoor", "t", "ON", eDoor(True)),
        ("t", "eDoor", "t", "closed", eDoor(False)),
        ("t", "eDoor", "t", '{"open": false}', eDoor(False)),
        ("t", "eText", "t", "12", eText("12")),
        ("t", "eText", "t", '{"words": "twelve"}', eText("twelve")),
        ("t", "eCount", "t", str(2**62 + 1), eCount(2**62 + 1)),
        ("t", "ePath", "t", "[1, 2.5]", ePath((1.0, 2.5))),
        ("t", {"event": "eAir", "if": "celsius > 20 and kind == \"air\""}, "t", '{"celsius": 21, "kind": "air"}', eAir(21.0)),
        ("t", {"event": "eAir", "if": "value > 20"}, "t", "20", None),
        ("t", {"event": "eAir", "if": "celsius > 20", "data": {"celsius": {"scale": 0.1}}}, "t", "30", None),
        ("{r}", {"event": "eAir", "if": 'r == "bath"'}, "hall", "30", None),
        ("{r}", {"event": "eAir", "condition": "room == {r}"}, 'ba"th', "3", eAir(3.0, condition='room == "ba\\"th"')),
        ("t", "eAir", "u", "1", None),
        ("a.c", "eRing", "abc", "", None),
    ],
)  # fmt: skip
def test_outcomes_of_a_message(pattern, rule, topic, payload, event):
    assert made(pattern, rule, topic, payload) == event


@pytest.mark.parametrize(
    ("condition", "payload", "event", "reason"),
    [
        ("wind.ok == true", '{"celsius": 3, "wind": {"ok": true}}', eAir(3.0), None),
        ("wind.ok == true", '{"celsius": 3, "wind": {"ok": false}}', None, None),
        ("wind.ok == true", '{"celsius": 3, "wind": {"okay": true}}', None, "if: no wind.ok to compare"),
        ("not wind.ok == true", '{"celsius": 3}', None, "if: no wind.ok to compare"),
        ("wind == true", '{"celsius": 3, "wind": {"ok": true}}', None, "if: no wind to compare"),
        ("wnd > 3", '{"celsius": 3, "wind": 4}', None, "if: no wnd to compare"),
        ("wind > 3", '{"celsius": 3, "wind": "4"}', None, "if: wind is not a number"),
        ("wind > 3", '{"celsius": 3, "wind": null}', None, "if: no wind to compare"),
        ("r > 3", "5", None, "if: r is not a number"),
        ('room == "?"', "5", eAir(5.0), None),
    ],
)  # fmt: skip
def test_a_message_without_a_name_in_if_is_passed_over(condition, payload, event, reason):
    noted = {}
    assert made("{r}", {"event": "eAir", "if": condition}, "hall", payload, noted) == event
    assert noted.get("passed over") == reason


def test_a_path_in_data_that_a_message_lacks_is_counted():
    rule, noted = {"event": "eAir", "data": {"room": "at.room"}}, {}
    assert made("t", rule, "t", '{"celsius": 3, "at": {"rom": "x"}}', noted) == eAir(3.0)
    assert noted == {"defaults": "no at.room, so room has its default"}
    assert made("t", rule, "t", '{"celsius": 3, "at": {"room": "x"}}') == eAir(3.0, "x")


@pytest.mark.parametrize(
    ("rule", "payload", "why"),
    [
        ("eAir", "warm", "celsius must be a real, not \"warm\""),
        ("eAir", "true", "celsius must be a real"),
        ("eAir", "null", "no value for celsius"),
        ("eAir", "NaN", "celsius must be"),
        ("eAir", "1e999", "celsius must be"),
        ("eAir", '{"kelvin": 3}', "no value for celsius"),
        ("eAir", b"\xff", "not UTF-8 text"),
        ("eAir", "[" * 50_000, "celsius must be"),
        ("eAir", "1" * 5000, "celsius must be"),
        ("eAir", "1" * 70_000, "the limit is 65536"),
        ("eCount", "1.5", "count must be a int"),
        ("eCount", str(2**64), "count must be a int"),
        ("eDoor", "ajar", "open must be a bool"),
        ("ePath", "[1, \"a\"]", "points must be"),
        ("eText", '{"words": "\\ud800"}', "words must be"),
    ],
)  # fmt: skip
def test_garbage(rule, payload, why):
    with pytest.raises(InvalidPayload, match=why):
        made("t", rule, "t", payload)


@pytest.mark.parametrize("level", ["", " ", "a b", "$x", "..", "\xfc", "#", "a\n"])
def test_a_topic_whose_level_is_no_id_has_no_event(level):
    """The coordinator removes a member that sends such a receiver, and anyone can publish one."""
    with pytest.raises(InvalidPayload, match=r"receivers: .* is not a valid agent id"):
        made("home/{room}/t", {"event": "eAir", "receivers": ["{room}"]}, f"home/{level}/t", "1")


@given(st.binary(max_size=200) | st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from(["celsius", "open", "value", "s"]), inner),
).map(lambda value: json.dumps(value).encode()))  # fmt: skip
def test_any_payload_is_an_event_or_garbage(payload):
    for rule in (
        "eAir",
        "eDoor",
        "eText",
        "eCount",
        "ePath",
        {"event": "eAir", "data": {"celsius": "s.0.s"}},
    ):
        try:
            event = made("t", rule, "t", payload)
        except InvalidPayload:
            continue
        assert VOCABULARY.check_event(event) is event


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"broker": "http://b"}, "broker is 'http://b'; expected mqtt://HOST"),
        ({"broker": "mqtt://b:port"}, "expected mqtt://HOST"),
        ({"broker": "mqtt://ann:secret@b"}, "password_env or password_file$"),
        ({"broker": "x://ann:secret@b"}, "broker is 'b'"),
        ({}, "nothing to do"),
        ({"topics": {"a#": "eAir"}}, "as whole levels"),
        ({"topics": {"a/#/b": "eAir"}}, "# as the last level only"),
        ({"topics": {"{a}/{a}": "eAir"}}, "a name for one level only"),
        ({"topics": {"": "eAir"}}, "65535 bytes"),
        ({"topics": {"a": 3}}, "must be an event type, or a table"),
        ({"topics": {"a": {"evnt": "eAir"}}}, "no 'evnt'; did you mean 'event'"),
        ({"topics": {"a": {}}}, "event must be a string"),
        ({"topics": {"a": {"event": "eAir", "if": "celsius >"}}}, "condition cannot be read"),
        ({"topics": {"a": {"event": "eAir", "condition": "x >"}}}, "condition cannot be read"),
        ({"topics": {"a": {"event": "eAir", "receivers": ["{b}"]}}}, "no level 'b'; its levels: none"),
        ({"topics": {"a": {"event": "eAir", "receivers": 3}}}, "a list of ids"),
        ({"topics": {"a": {"event": "eAir", "data": {"celsius": {"scale": "2"}}}}}, "must be numbers"),
        ({"topics": {"a": {"event": "eAir", "data": {"celsius": 3}}}}, "a string or a table"),
        ({"topics": {"a": {"event": "eAir", "qos": 3}}}, "qos is 3; expected 0, 1 or 2"),
        ({"topics": {"a": {"event": "eAir", "retained": 1}}}, "true or false"),
        ({"topics": {"a": "eAir"}, "keeps": True}, "requires the option client"),
        ({"topics": {"a": "eAir"}, "password_env": "X"}, "requires the option user"),
        ({"topics": {"a": "eAir"}, "user": "u", "password_env": "X", "password_file": "y"}, "not both"),
        ({"topics": {"a": "eAir"}, "key": "x"}, "requires the option cert"),
        ({"topics": {"a": "eAir"}, "status": "a/#"}, "expected a topic"),
        ({"topics": {"a": "eAir"}, "most": -1}, "most is -1"),
        ({"publish": {"PLamp": "a/+"}}, "without [+] and #"),
        ({"publish": {"PLamp": {"topic": "a", "retian": True}}}, "did you mean 'retain'"),
        ({"publish": {"PLamp": "a"}, "every": -1}, "every is -1"),
    ],
)  # fmt: skip
def test_inputs_rejected_at_once(options, problem):
    with pytest.raises(MinervaError, match=problem) as refused:
        Mqtt(**{"broker": "mqtt://b"} | options)
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"topics": {"a": "eAer"}}, "no event type eAer; did you mean 'eAir'"),
        ({"topics": {"a": {"event": "eAir", "data": {"kelvin": "k"}}}}, "eAir has no kelvin"),
        ({"topics": {"a": {"event": "eAir", "data": {"celsius": {"unit": "m"}}}}}, "not in m"),
        ({"topics": {"a": {"event": "eText", "data": {"words": {"scale": 2}}}}}, "has no scale and offset"),
        ({"topics": {"a": {"event": "eAir", "data": {"room": "{r}"}}}}, "has no level {r}"),
        ({"topics": {"a": "eMap"}}, "which messages cannot carry"),
        ({"topics": {"a": {"event": "eAir", "if": "celsius == true"}}}, "if:1:1: celsius of a message for eAir is a number"),
        ({"topics": {"a": {"event": "ePath", "if": "points == 3"}}}, "points of .* cannot be compared"),
        ({"topics": {"a": {"event": "eAir", "if": "#r1.x > 3"}}}, "has no #r1.x"),
        ({"publish": {"PLump": "a"}}, "no primitive PLump; did you mean 'PLamp'"),
        ({"publish": {"PLamp": "a/{off}"}}, "unknown parameter off"),
        ({"topics": {"a": "eAir"}, "user": "u", "password_env": "NO_SUCH"}, "variable NO_SUCH is not set"),
        ({"topics": {"a": "eAir"}, "user": "u", "password_file": "/none"}, "/none: No such file"),
    ],
)  # fmt: skip
def test_hellos_that_are_rejected(options, problem):
    service = Mqtt("mqtt://b", **options)
    with pytest.raises(MinervaError, match=problem):
        service.joined(WorldInfo("w", VOCABULARY, 0, 0.1))


def test_without_the_library(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "paho.mqtt.client", None)
    with pytest.raises(MinervaError, match=r"pip install 'minerva-bus\[mqtt\]'"):
        Mqtt("b", topics={"a": "eAir"}).joined(WorldInfo("w", VOCABULARY, 0, 0.1))


@pytest.mark.parametrize(
    ("address", "broker"),
    [
        ("b", Broker("b", 1883, False)),
        ("mqtt://b:99/", Broker("b", 99, False)),
        ("mqtts://b", Broker("b", 8883, True)),
        ("mqtt://[::1]:5", Broker("::1", 5, False)),
    ],
)
def test_addresses(address, broker):
    assert Broker.at(address) == broker


def test_a_password_is_never_shown(monkeypatch):
    monkeypatch.setenv("WORD", "s3cret")
    login = Login(user="ann", password_env="WORD")
    assert login.password() == "s3cret"
    assert "s3cret" not in repr(login)


LEVELS = st.lists(
    st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"])), min_size=1
)


@given(LEVELS, st.data())
def test_a_pattern_gives_back_the_levels_that_it_names(levels, data):
    named = data.draw(st.lists(st.booleans(), min_size=len(levels), max_size=len(levels)))
    topic = "/".join(levels)
    plain = [set(level) & set("+#{}") for level in levels]
    text = "/".join(
        f"{{l{i}}}" if name or odd else level
        for i, (level, name, odd) in enumerate(zip(levels, named, plain, strict=True))
    )
    if text:
        names = Pattern.of(text).levels(topic)
        assert names is not None
        assert all(names[name] == levels[int(name[1:])] for name in names)
        assert Pattern.of(text).levels(topic + "/more") is None


def test_so_many_a_second_and_no_more():
    now = [0.0]
    allowed = RateLimiter(2, lambda: now[0])
    assert [allowed.take() for _ in range(3)] == [True, True, False]
    now[0] = 0.5
    assert [allowed.take() for _ in range(2)] == [True, False]
    now[0] = 100.0
    assert [allowed.take() for _ in range(3)] == [True, True, False]
    assert all(RateLimiter(0).take() for _ in range(100))


class Wire:
    """A client that accepts `takes` more messages."""

    def __init__(self):
        self.sent, self.takes = [], 0

    def publish(self, topic, payload, qos=0, *, retain=False):
        if not self.takes:
            return False
        self.takes -= 1
        self.sent.append((topic, payload))
        return True


def test_of_what_waits_the_newest_counts():
    counts, wire = [], Wire()
    outbox = MqttOutbox(counts.append)
    outbox.put({"a": MqttMessage(b"1"), "b": MqttMessage(b"1")})
    outbox.put({"a": MqttMessage(b"2"), "b": MqttMessage(b"1")})
    outbox.send(wire)
    assert wire.sent == []
    wire.takes = 1
    outbox.send(wire)
    assert wire.sent == [("b", b"1")]
    wire.takes = 5
    outbox.send(wire)
    outbox.send(wire)
    assert wire.sent == [("b", b"1"), ("a", b"2")]
    assert counts == ["replaced", "published", "published"]
    outbox.reconnected()
    outbox.send(wire)
    assert wire.sent[2:] == [("a", b"2"), ("b", b"1")]
