"""The state of a conversation with another agent, as one figure of the agent's state.

Conversations are part of the string, like the rest of an agent's state. So they are recorded,
compared and resumed with the agent, and move with it from one process to another.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Default
from minerva_bus.grammar.scene import EMPTY, FigureNode, Scene
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import Primitive
from minerva_messages.message import NEVER, answered_to
from minerva_messages.protocols import PROTOCOLS, START, Protocol, Role

PConversation = Primitive(
    "PConversation",
    id=str,
    protocol=Type("text", words=tuple(PROTOCOLS)),
    role=Type("text", words=tuple(Role)),
    peer=str,
    state=Default(str, START),
    deadline=Default(int, NEVER),
    content=Default(str, ""),
    reply_with=Default(str, ""),
    to=Default(tuple[str, ...], ()),
)


@dataclass(frozen=True, slots=True)
class Conversation:
    """A conversation with one other agent.

    `content` and `reply_with` are those of the last message of `peer`; `to` receives answers.
    `deadline` is the last frame in which the next act is valid, or -1.
    """

    id: str
    # Texts instead of objects: each field is a parameter of the figure
    # that describes the conversation.
    protocol: str
    role: str
    peer: str
    state: str = START
    deadline: int = NEVER
    content: str = ""
    reply_with: str = ""
    to: tuple[str, ...] = ()

    @staticmethod
    def of(figure: FigureNode) -> Conversation:
        """The conversation that a figure describes."""
        return Conversation(**figure.parameters)

    @property
    def string(self) -> Scene:
        """The figure that describes it, as a string."""
        return PConversation(*(getattr(self, name) for name in PConversation.fields.names))

    @property
    def rules(self) -> Protocol:
        """Its protocol's table."""
        return PROTOCOLS[self.protocol]

    @property
    def over(self) -> bool:
        """Whether it is in a final state."""
        return self.rules.ends(self.state)

    def expired(self, frame: int) -> bool:
        """Whether its deadline has passed."""
        return NEVER < self.deadline < frame

    def sent(self, act: str, deadline: int = NEVER) -> Conversation | None:
        """The conversation after an act of this side; None if the protocol forbids it."""
        state = self.rules.after(self.state, Role(self.role), act)
        return replace(self, state=state, deadline=deadline) if state else None

    def received(self, message: Event) -> Conversation | None:
        """The conversation after a message of the other side; None if the protocol forbids it."""
        state = self.rules.after(self.state, Role(self.role).other, message.performative)
        # Later messages of a conversation may omit the protocol.
        if not state or message.protocol not in ("", self.protocol):
            return None
        return replace(
            self,
            state=state,
            deadline=message.reply_by,
            # Kept in the state, because the agent may answer in a later frame.
            content=message.content,
            reply_with=message.reply_with,
            to=answered_to(message),
        )


class Conversations:
    """The conversations of one agent, oldest first. Immutable; `scene` is their string."""

    __slots__ = ("scene",)

    def __init__(self, scene: Scene = EMPTY) -> None:
        self.scene = scene

    def __iter__(self) -> Iterator[Conversation]:
        return map(Conversation.of, self._figures())

    def __len__(self) -> int:
        return len(self.scene)

    def find(self, id: str, peer: str) -> Conversation | None:
        """The conversation with this id and agent, or None."""
        figure = self._figure(id, peer)
        return None if figure is None else Conversation.of(figure)

    def keep(self, *conversations: Conversation) -> Conversations:
        """A copy with the given states: existing ones are replaced, new ones are appended.

        Conversations that are over are removed.
        """
        kept = self
        for conversation in conversations:
            kept = kept._with(conversation)
        return kept

    def drop(self, conversation: Conversation) -> Conversations:
        """A copy without a conversation."""
        old = self._figure(conversation.id, conversation.peer)
        return Conversations(Scene(tuple([node for node in self.scene if node is not old])))

    def _with(self, conversation: Conversation) -> Conversations:
        # Conversations that are over are removed, so that the state of an agent does not grow.
        if conversation.over:
            return self.drop(conversation)
        old = self._figure(conversation.id, conversation.peer)
        if old is None:
            return Conversations(self.scene + conversation.string)
        (new,) = conversation.string
        return Conversations(Scene(tuple([new if node is old else node for node in self.scene])))

    def _figure(self, id: str, peer: str) -> FigureNode | None:
        for figure in self._figures():
            parameters = figure.parameters
            if parameters["id"] == id and parameters["peer"] == peer:
                return figure
        return None

    def _figures(self) -> Iterator[FigureNode]:
        for node in self.scene:
            if isinstance(node, FigureNode) and node.symbol == PConversation.name:
                yield node
