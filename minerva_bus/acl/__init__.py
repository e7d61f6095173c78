"""Messages between agents: FIPA ACL as events, and conversations as part of the string.

    acts           the 22 communicative acts, SC00037
    message        the event type `eMessage` with the parameters of SC00061, and replies
    protocols      request, query, contract net, subscribe and propose as tables
    conversation   where one agent stands with another, by such a table
    hearing        what a message does to an agent's conversations; pure
    talker         a base class for agents that converse
    outside        agents that stand for those outside the world
    kqml           KQML's performatives

A vocabulary takes it all in by one line: `Vocabulary.of(*MESSAGES, ...)`. See docs/messages.md.
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
"""What a vocabulary needs where agents converse."""

OUTSIDE = (Outside, TOutside, PMail, eMail)
"""What it needs besides where some of them live outside the world."""

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
