"""Who may say and hear what on a world's keys, as Zenoh's access control has it.

All is forbidden but what a rule allows. A rule holds for one common name, since Zenoh knows no
templates: what a member says is on keys that end with its own name, so that nobody can speak as
another; but for those of a family, whose common name and whose rules are the same (hosts-$*). Each
router of Zenoh's enforces for itself: the coordinator's session, and those between.
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
    """Zenoh's `access_control` for a world; whoever is revoked or unknown may do nothing.

    `local` are the link protocols by which processes of this machine come, who may do all.
    `carrier`: it is for a router between networks, to which the coordinator is a link as well.
    """
    rules = [_rule(_OPEN, (_IN, _OUT), _ALL, ["**"])]
    open_to = [{"id": f"by {one}", "link_protocols": [one]} for one in sorted(local)]
    trusted = {HUB, ROUTER} if carrier else {ROUTER}
    subjects, policies = list(open_to), list[dict[str, Any]]()
    for one in sorted(rights, key=lambda one: one.name):
        if one.revoked:
            continue
        subject: dict[str, Any] = {"id": one.name, "cert_common_names": [one.name]}
        if one.may(*trusted):
            subjects.append(subject)
            open_to.append(subject)
        elif not one.may(HUB):
            own = _rules(keys, one)
            rules += own
            subjects.append({**subject, "link_protocols": list(SECURED)})
            policies.append({"rules": [rule["id"] for rule in own], "subjects": [one.name]})
    if open_to:
        policies.append({"rules": [_OPEN], "subjects": [subject["id"] for subject in open_to]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules(keys: Keys, one: Rights) -> list[Rule]:
    """What one member, view or operator may do; what goes to it is seen from the hub: egress."""
    name, own = one.name, _own(one)
    hears, asks = _hears(keys, one), [asking_key(ANY_WORLD, own)]
    if one.may(OPERATOR):
        asks.append(control_key(ANY_WORLD, own))
    told = [keys.alive(COORDINATOR), keys.alive(own)]
    wants = [keys.sent_by("*"), f"{keys.base}/topic/*/*"]
    return [
        _rule(f"{name} says", (_IN,), _PUT, _says(keys, one)),
        _rule(f"{name} is there", (_IN,), _TOKEN, [keys.alive(own)]),
        _rule(f"{name} looks who is there", (_IN,), _LIVELINESS, told),
        _rule(f"{name} is told who is there", (_OUT,), _TOKEN, told),
        _rule(f"{name} listens", (_IN,), _SUBSCRIBE, hears),
        _rule(f"{name} hears", (_OUT,), _PUT, hears),
        _rule(f"{name} learns that it is heard", (_OUT,), _SUBSCRIBE, wants),
        _rule(f"{name} asks", (_IN,), ("query",), asks),
        _rule(f"{name} is answered", (_OUT,), ("reply",), asks),
    ]


def _own(one: Rights) -> str:
    """Its name as the last chunk of a key, or all names of its family."""
    start = family_start(one.name)
    return f"{start}$*" if start else one.name


def _says(keys: Keys, one: Rights) -> list[str]:
    found = [keys.sent_by(_own(one))]
    if one.may(GENERATOR):
        topics = sorted(one.topics) or ["*"]
        found += [f"{keys.base}/topic/{topic}/{_own(one)}" for topic in topics]
    return found


def _hears(keys: Keys, one: Rights) -> list[str]:
    found = [f"{keys.base}/to/{_own(one)}", keys.all]
    if one.may(AGENT):
        found.append(keys.evolve)
    if one.may(GENERATOR):
        found.append(keys.tick)
    if one.may(GENERATOR, VIEW):
        found.append(f"{keys.base}/topic/*/*")
    if one.may(VIEW):
        found.append(keys.view("*"))
    if one.may(VIEW, OPERATOR):
        found.append(keys.record)
    return found


def _rule(id: str, flows: tuple[str, ...], messages: tuple[str, ...], on: list[str]) -> Rule:
    return {
        "id": id,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": on,
    }
