"""The access rules for Zenoh: messages that no member may send."""

import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus.security.access import access_control
from minerva_bus.security.credentials import HUB, ROLES, ROUTER, Rights
from minerva_bus.wire.keys import COORDINATOR, Keys, asking_key, control_key

KEYS = Keys("w")
MEMBERS = sorted(set(ROLES) - {HUB, ROUTER})
TOPICS = st.frozensets(st.sampled_from(["scan", "image"]))
NAMES = st.sampled_from(["a", "b", "ab", "a.b", "coordinato", "steps-1"])
RIGHTS = st.builds(
    Rights, NAMES, st.frozensets(st.sampled_from(MEMBERS), min_size=1), topics=TOPICS,
    revoked=st.booleans(),
)  # fmt: skip
MANY = st.lists(RIGHTS, unique_by=lambda rights: rights.name, max_size=4)


def may(access, name, flow, message, key):
    """Zenoh's decision: a message passes if the key of a matching rule includes its key."""
    wanted = zenoh.KeyExpr(key)
    of_name = {
        rule
        for policy in access["policies"]
        if name in policy["subjects"]
        for rule in policy["rules"]
    }
    return any(
        rule["id"] in of_name
        and flow in rule["flows"]
        and message in rule["messages"]
        and any(zenoh.KeyExpr(expression).includes(wanted) for expression in rule["key_exprs"])
        for rule in access["rules"]
    )


@given(MANY)
@settings(max_examples=30)
def test_a_message_in_another_name_is_rejected(holders):
    access = access_control(KEYS, holders, [])
    for holder in holders:
        others = {other.name for other in holders} - {holder.name} | {COORDINATOR, "*"}
        for key in (KEYS.all, KEYS.tick, KEYS.evolve, KEYS.record, KEYS.view("e"),
                    KEYS.to(holder.name), "**", f"{KEYS.base}/**", KEYS.epoch(9)):  # fmt: skip
            assert not may(access, holder.name, "ingress", "put", key)
        for other in others:
            assert not may(access, holder.name, "ingress", "put", KEYS.sent_by(other))
            assert not may(access, holder.name, "ingress", "liveliness_token", KEYS.alive(other))
            assert not may(access, holder.name, "ingress", "put", KEYS.topic("scan", other))
            for key in (control_key("w", other), asking_key("w", other), control_key("w")):
                assert not may(access, holder.name, "ingress", "query", key)
        for key in (
            "**",
            f"{KEYS.base}/**",
            KEYS.sent_by("*"),
            f"{KEYS.base}/to/*",
            KEYS.alive("*"),
        ):
            assert not may(access, holder.name, "ingress", "declare_subscriber", key)
        assert not may(access, holder.name, "ingress", "declare_queryable", control_key("w"))


@given(MANY)
@settings(max_examples=30)
def test_every_member_does_what_its_roles_allow(holders):
    access = access_control(KEYS, holders, [])
    for holder in holders:

        def has(*roles, holder=holder):
            return holder.may(*roles)

        name, there = holder.name, not holder.revoked
        topic = KEYS.topic("scan", name)
        listed = "scan" in holder.topics
        expected = [
            ("ingress", "put", KEYS.sent_by(name), there),
            ("ingress", "liveliness_token", KEYS.alive(name), there),
            ("ingress", "declare_subscriber", KEYS.to(name), there),
            ("egress", "put", KEYS.all, there),
            ("egress", "declare_subscriber", KEYS.sent_by("*"), there),
            ("ingress", "put", topic, has("generator") and listed),
            ("ingress", "put", f"{KEYS.base}/topic/*/{name}", False),
            ("ingress", "declare_subscriber", KEYS.tick, has("generator")),
            ("egress", "put", KEYS.evolve, has("agent")),
            ("egress", "put", KEYS.view("eShow"), has("view")),
            ("egress", "put", KEYS.record, has("view", "operator")),
            ("ingress", "query", asking_key("*", name), there),
            ("egress", "reply", asking_key("w", name), there),
            ("ingress", "query", control_key("w", name), has("operator")),
        ]
        for flow, message, key, allowed in expected:
            assert may(access, name, flow, message, key) == allowed, (flow, message, key)


@given(MANY, st.booleans())
@settings(max_examples=30)
def test_no_id_is_unknown_and_none_is_there_twice(holders, carrier):
    """Zenoh accepts unknown ids silently."""
    holders = [
        *holders, Rights("mid", frozenset({ROUTER})), Rights(COORDINATOR, frozenset({HUB}))
    ]  # fmt: skip
    access = access_control(KEYS, holders, ["unixsock-stream"], carrier=carrier)
    assert access["default_permission"] == "deny"
    for what in ("rules", "subjects"):
        ids = [entry["id"] for entry in access[what]]
        assert len(ids) == len(set(ids))
        used = {id for policy in access["policies"] for id in policy[what]}
        assert used == set(ids)
    for subject in access["subjects"]:
        by_name = "cert_common_names" in subject
        assert subject["link_protocols"] == (["tls", "quic"] if by_name else ["unixsock-stream"])
    named = {id for policy in access["policies"] for id in policy["subjects"]}
    expected = {
        holder.name for holder in holders if not holder.revoked and holder.name != COORDINATOR
    }
    assert named == expected | {"by unixsock-stream"} | ({COORDINATOR} if carrier else set())
    zenoh.Config().insert_json5("access_control", str(access).replace("True", "true"))
