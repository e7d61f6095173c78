"""Slow participants, such as language models: requests and answers as events.

    symbols   event types of requests and answers, and the figures of a `Mind`
    mind      the agent that represents a backend, keeps open requests and forwards answers
    form      JSON Schema of an event type, and events from JSON

A vocabulary includes the symbols by `Vocabulary.of(*MINDS, ...)`. See extensions/assistants/llm.md.
"""

from minerva_assistants.minds.mind import Mind
from minerva_assistants.minds.symbols import (
    PAccounts,
    PRequests,
    TMind,
    eAnswer,
    eAsk,
    eNoAnswer,
    eRemind,
    eReply,
    eThink,
)

MINDS = (Mind, PAccounts, PRequests, TMind, eAnswer, eAsk, eNoAnswer, eRemind, eReply, eThink)
"""Symbols that a vocabulary needs if agents send requests to a mind."""

__all__ = [
    "MINDS",
    "Mind",
    "PAccounts",
    "PRequests",
    "TMind",
    "eAnswer",
    "eAsk",
    "eNoAnswer",
    "eRemind",
    "eReply",
    "eThink",
]
