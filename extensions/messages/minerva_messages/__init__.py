"""Messages between agents: FIPA ACL as events, and conversations as part of the string.

    acts           the 22 communicative acts, SC00037
    message        the event type `eMessage` with the parameters of SC00061, and replies
    protocols      request, query, contract net, subscribe and propose as tables
    conversation   state of a conversation with one other agent, according to such a table
    receiving        effect of a message on an agent's conversations; pure
    talker         base class of agents that converse
    outside        agents that represent others outside of the world
    kqml           KQML's performatives

A vocabulary includes the symbols by `Vocabulary.of(*MESSAGES, ...)`. See
extensions/messages/messages.md.
"""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_messages.acts import Act
    from minerva_messages.conversation import Conversation, Conversations, PConversation
    from minerva_messages.message import eMessage, reply
    from minerva_messages.outside import OUTSIDE, Outside, PMail, TOutside, eMail
    from minerva_messages.protocols import (
        CONTRACT_NET,
        PROPOSE,
        QUERY,
        REQUEST,
        SUBSCRIBE,
        Protocol,
        Role,
    )
    from minerva_messages.talker import MESSAGES, Talker

__getattr__ = imported_at_first_use(
    __name__,
    {
        "acts": "Act",
        "conversation": "Conversation Conversations PConversation",
        "message": "eMessage reply",
        "outside": "OUTSIDE Outside PMail TOutside eMail",
        "protocols": "CONTRACT_NET PROPOSE QUERY REQUEST SUBSCRIBE Protocol Role",
        "talker": "MESSAGES Talker",
    },
)

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
