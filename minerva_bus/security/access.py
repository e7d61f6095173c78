"""Zenoh's access control for a world: the keys that each certificate may use.

Everything is forbidden unless a rule allows it. Zenoh has no templates, so each common name has its
own rules. A member publishes on keys that end with its name, so that it cannot impersonate another
one; the members of a family share a common name and its rules (hosts-$*), and can impersonate each
other. Each Zenoh router enforces the rules itself: the coordinator's session, and routers between.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from minerva_bus.security.credentials import (
    AGENT,
    GENERATOR,
    HUB,
    OPERATOR,
    ROUTER,
    SECURED,
    VIEW,
    Rights,
    family_start,
)
from minerva_bus.wire.keys import ANY_WORLD, COORDINATOR, Keys, asking_key, control_key

_PUT: Final = ("put", "delete")
_SUBSCRIBE: Final = ("declare_subscriber",)
_LIVELINESS: Final = ("liveliness_query", "declare_liveliness_subscriber")
_TOKEN: Final = ("liveliness_token",)
_ALL: Final = (
    *_PUT, *_SUBSCRIBE, *_LIVELINESS, *_TOKEN, "query", "declare_queryable", "reply",
)  # fmt: skip
_IN, _OUT = "ingress", "egress"
_OPEN: Final = "everything"

Rule = dict[str, Any]


def access_control(
    keys: Keys, rights: Iterable[Rights], local: Iterable[str], *, carrier: bool = False
) -> dict[str, Any]:
    """Zenoh's `access_control` for a world; revoked and unknown certificates have no rights.

    `local`: the link protocols of processes on this machine, which have all rights. `carrier`:
    the rules are for a router between networks, to which the coordinator connects, too.
    """
    # One rule for trusted processes: those of this machine, and routers.
    rules = [_rule(_OPEN, (_IN, _OUT), _ALL, ["**"])]
    open_to = [{"id": f"by {kind}", "link_protocols": [kind]} for kind in sorted(local)]
    trusted = {HUB, ROUTER} if carrier else {ROUTER}
    subjects, policies = list(open_to), list[dict[str, Any]]()
    for holder in sorted(rights, key=lambda holder: holder.name):
        if holder.revoked:
            continue
        # A common name is only valid on links that authenticate it.
        subject: dict[str, Any] = {
            "id": holder.name,
            "cert_common_names": [holder.name],
            "link_protocols": list(SECURED),
        }
        if holder.may(*trusted):
            subjects.append(subject)
            open_to.append(subject)
        # Without a rule the default applies: a member that uses the
        # coordinator's certificate has no rights.
        elif not holder.may(HUB):
            own = _rules(keys, holder)
            rules += own
            subjects.append(subject)
            policies.append({"rules": [rule["id"] for rule in own], "subjects": [holder.name]})
    if open_to:
        policies.append({"rules": [_OPEN], "subjects": [subject["id"] for subject in open_to]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules(keys: Keys, holder: Rights) -> list[Rule]:
    """The rules of one member, view or operator.

    Flows are seen from the hub: `ingress` is what the member sends, `egress` what it receives.
    """
    name, own = holder.name, _own_chunk(holder)
    assets = f"{keys.base}/asset"
    received, asked = _received(keys, holder, own), [asking_key(ANY_WORLD, own), f"{assets}/*"]
    if holder.may(OPERATOR):
        asked.append(control_key(ANY_WORLD, own))
    # A member needs its own tokens to check that its name is free, and the coordinator's to detect
    # that it is gone; the names of other members stay hidden.
    declared = [keys.alive(own), keys.claim(own)]
    tokens = [keys.alive(COORDINATOR), *declared]
    sent = [keys.sent_by("*"), f"{keys.base}/topic/*/*"]
    return [
        _rule(f"{name} publishes", (_IN,), _PUT, _sent(keys, holder, own)),
        _rule(f"{name} declares its token", (_IN,), _TOKEN, declared),
        _rule(f"{name} watches tokens", (_IN,), _LIVELINESS, tokens),
        _rule(f"{name} receives tokens", (_OUT,), _TOKEN, tokens),
        _rule(f"{name} subscribes", (_IN,), _SUBSCRIBE, received),
        _rule(f"{name} receives", (_OUT,), _PUT, received),
        # A publisher sends nothing to the hub until it is notified of a subscriber there.
        _rule(f"{name} receives subscriptions", (_OUT,), _SUBSCRIBE, sent),
        _rule(f"{name} asks", (_IN,), ("query",), asked),
        _rule(f"{name} receives answers", (_OUT,), ("reply",), asked),
        _rule(f"{name} has assets", (_IN,), ("declare_queryable", "reply"), [f"{assets}/{own}"]),
        _rule(f"{name} is asked for assets", (_OUT,), ("query",), [f"{assets}/*"]),
    ]


def _own_chunk(holder: Rights) -> str:
    """A member's name as the last chunk of a key; for a family a pattern of all its names."""
    start = family_start(holder.name)
    return f"{start}$*" if start else holder.name


def _sent(keys: Keys, holder: Rights, own: str) -> list[str]:
    # Zenoh must enforce restrictions of topics, because readings bypass the coordinator.
    # No pattern stands for all topics: it would permit a put on the pattern itself, which reaches
    # subscribers of every topic, whatever the hello says.
    topics = sorted(holder.topics) if holder.may(GENERATOR) else []
    return [keys.sent_by(own), *(f"{keys.base}/topic/{topic}/{own}" for topic in topics)]


def _received(keys: Keys, holder: Rights, own: str) -> list[str]:
    by_roles = (
        ((AGENT,), keys.evolve),
        ((GENERATOR,), keys.tick),
        ((GENERATOR, VIEW), f"{keys.base}/topic/*/*"),
        ((VIEW,), keys.view("*")),
        ((VIEW, OPERATOR), keys.record),
    )
    own_keys = [f"{keys.base}/to/{own}", keys.all]
    return own_keys + [key for roles, key in by_roles if holder.may(*roles)]


def _rule(id: str, flows: tuple[str, ...], messages: tuple[str, ...], keys: list[str]) -> Rule:
    return {
        "id": id,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": keys,
    }
