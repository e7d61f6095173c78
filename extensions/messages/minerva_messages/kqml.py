"""KQML's performatives and the nearest acts of FIPA.

The performatives are the 36 of Labrou and Finin, A Proposal for a new KQML Specification, TR
CS-97-03. KQML describes the contents of knowledge bases, FIPA the intentions of agents, so the
nearest act is not an equivalent. Performatives that manage streams of answers have no counterpart.
The inverse mapping returns the original performative if possible.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from minerva_bus.errors import MisuseError, nearest
from minerva_messages.acts import ACTS, Act

NEAREST: Final[Mapping[str, Act | None]] = MappingProxyType(
    {
        "achieve": Act.REQUEST,
        "advertise": Act.INFORM,
        "ask-all": Act.QUERY_REF,
        "ask-if": Act.QUERY_IF,
        "ask-one": Act.QUERY_REF,
        "broadcast": Act.PROPAGATE,
        "broker-all": Act.PROXY,
        "broker-one": Act.PROXY,
        "delete-all": Act.REQUEST,
        "delete-one": Act.REQUEST,
        "deny": Act.DISCONFIRM,
        "discard": Act.CANCEL,
        "eos": None,
        "error": Act.NOT_UNDERSTOOD,
        "forward": Act.PROXY,
        "insert": Act.INFORM,
        "next": None,
        "ready": Act.AGREE,
        "recommend-all": Act.QUERY_REF,
        "recommend-one": Act.QUERY_REF,
        "recruit-all": Act.PROXY,
        "recruit-one": Act.PROXY,
        "register": Act.INFORM,
        "rest": None,
        "sorry": Act.REFUSE,
        "standby": None,
        "stream-all": Act.QUERY_REF,
        "subscribe": Act.SUBSCRIBE,
        "tell": Act.INFORM,
        "transport-address": Act.INFORM,
        "unachieve": Act.CANCEL,
        "unadvertise": Act.DISCONFIRM,
        "undelete": Act.CANCEL,
        "uninsert": Act.DISCONFIRM,
        "unregister": Act.INFORM,
        "untell": Act.DISCONFIRM,
    }
)
"""The nearest act of each performative, or None."""

_BACK: Final[Mapping[Act, str]] = MappingProxyType(
    {
        Act.CANCEL: "discard",
        Act.CONFIRM: "tell",
        Act.DISCONFIRM: "deny",
        Act.FAILURE: "sorry",
        Act.INFORM: "tell",
        Act.NOT_UNDERSTOOD: "error",
        Act.PROPAGATE: "broadcast",
        Act.PROXY: "broker-one",
        Act.QUERY_IF: "ask-if",
        Act.QUERY_REF: "ask-one",
        Act.REFUSE: "sorry",
        Act.REQUEST: "achieve",
        Act.SUBSCRIBE: "subscribe",
    }
)


def act_of(performative: str) -> Act | None:
    """The act nearest to a KQML performative, or None.

    Raises MisuseError for a text that is not a performative of KQML.
    """
    if performative not in NEAREST:
        near = nearest(performative, list(NEAREST))
        raise MisuseError(f"{performative!r} is not a performative of KQML{near}")
    return NEAREST[performative]


def performative_of(act: Act | str) -> str | None:
    """The KQML performative nearest to an act, or None.

    Raises MisuseError for a text that is not a communicative act.
    """
    try:
        return _BACK.get(Act(act))
    except ValueError:
        near = nearest(str(act), list(ACTS))
        raise MisuseError(f"{str(act)!r} is not a communicative act{near}") from None
