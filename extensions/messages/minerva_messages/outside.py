"""Agents that represent others outside of the world, such as on another agent platform.

Messages for an outside agent are sent to its representative, which keeps the latest ones as figures
and shows them. A bridge is a device whose geometric system is one of messages, like an MQTT broker:
α of `PMail` sends it. Messages from outside are events of the bridge, with the representative as
their sender.
"""

from __future__ import annotations

from typing import Any

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Default
from minerva_bus.grammar.scene import EMPTY, Scene
from minerva_bus.grammar.vocabulary import EventType, Primitive, Transformation
from minerva_bus.world.agent import Agent
from minerva_bus.world.class_declaration import on, view
from minerva_bus.world.context import Context
from minerva_messages.message import NEVER, eMessage

eMail = EventType("eMail", visual=True)  # noqa: N816 - event types begin with e

TOutside = Transformation("TOutside", id=str)

_parameters: dict[str, Any] = {
    # All parameters of a message are parameters of the figure, so that
    # the bridge can send it as it is.
    field.name: field.type if field.default is None else Default(field.type, field.default)
    for field in eMessage.fields.all
}
PMail = Primitive("PMail", frame=int, sender=str, **_parameters)


class Outside(Agent, symbol="AOutside"):
    """Represents an agent elsewhere; `mail` has the messages that it received in `frame`."""

    frame: int = NEVER
    mail: Scene = EMPTY

    @on("eMessage")
    def take(self, message: Event, moment: Context) -> None:
        """Keep a message until the next frame with messages."""
        # Messages from outside have the representative as sender;
        # without receivers they reach it, too.
        if message.sender == self.id:
            return
        # The first message of a frame replaces those of the last frame with messages.
        if self.frame != moment.number:
            self.frame, self.mail = moment.number, EMPTY
        self.mail += PMail(self.frame, message.sender, *message.values)

    @view("eMail")
    def show(self, event: Event) -> Scene:
        """Its id with the messages of the last frame that had any."""
        return TOutside(self.id)(self.mail)


OUTSIDE = (Outside, TOutside, PMail, eMail)
"""Symbols that a vocabulary needs beside MESSAGES if agents are outside of the world."""
