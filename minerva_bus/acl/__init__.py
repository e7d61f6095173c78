"""Messages between agents: FIPA ACL as events, and conversations as part of the string.

    acts           the 22 communicative acts, SC00037
    message        the event type `eMessage` with the parameters of SC00061, and replies
    protocols      request, query, contract net, subscribe and propose as tables
    conversation   state of a conversation with one other agent, according to such a table
    receiving        effect of a message on an agent's conversations; pure
    talker         base class of agents that converse
    outside        agents that represent others outside of the world
    kqml           KQML's performatives

A vocabulary includes the symbols by `Vocabulary.of(*MESSAGES, ...)`. See docs/messages.md.
"""

from minerva_bus.acl.acts import Act
from minerva_bus.acl.conversation import Conversation, Conversations, PConversation
from minerva_bus.acl.message import eMessage, reply
from minerva_bus.acl.outside import Outside, PMail, TOutside, eMail
from minerva_bus.acl.protocols import (
    CONTRACT_NET,
    PROPOSE,
    QUERY,
    REQUEST,
    SUBSCRIBE,
    Protocol,
    Role,
)
from minerva_bus.acl.talker import Talker

MESSAGES = (eMessage, PConversation)
"""Symbols that a vocabulary needs if agents converse."""

OUTSIDE = (Outside, TOutside, PMail, eMail)
"""Further symbols that it needs if some of the agents are outside of the world."""

__all__ = [
    "CONTRACT_NET",
    "MESSAGES",
    "OUTSIDE",
    "PROPOSE",
    "QUERY",
    "REQUEST",
    "SUBSCRIBE",
    "Act",
    "Conversation",
    "Conversations",
    "Outside",
    "PConversation",
    "PMail",
    "Protocol",
    "Role",
    "TOutside",
    "Talker",
    "eMail",
    "eMessage",
    "reply",
]
