"""A small world with external agents: a buyer that calls them and a clerk that serves them."""

from minerva_bus import EventType, Vocabulary, on
from minerva_messages import CONTRACT_NET, MESSAGES, OUTSIDE, Talker, eMessage

eStep = EventType("eStep")
eDone = EventType("eDone")
eOver = EventType("eOver")


class Buyer(Talker, symbol="ABuyer"):
    """Calls for proposals once the clerk has been served, and accepts the proposal."""

    heard_from: tuple[str, ...] = ()

    @on("eDone")
    def call(self, done, moment):
        if done.sender == "clerk":
            self.open(
                moment,
                CONTRACT_NET,
                ["alice"],
                'PJob<what="käse & brot">',
                language="minerva",
                reply_by=moment.number + 400,
            )

    def received(self, message, conversation, moment):
        self.heard_from += (f"{message.sender} {message.performative} {message.content}",)
        if conversation.state == "proposed":
            self.award(moment, [conversation], conversation)
        elif conversation.over:
            moment.emit(eOver())


class Clerk(Talker, symbol="AClerk"):
    """Fulfils each request."""

    served: int = 0

    @on("eStep")
    def begin(self, step, moment):
        if moment.number == 0:
            moment.emit(eMessage("inform", "open", receivers=["alice"]))

    def received(self, message, conversation, moment):
        if conversation and conversation.state == "requested":
            self.served += 1
            agreed = self.say(moment, conversation, "agree")
            self.say(moment, agreed, "inform", f"done: {message.content}")
        elif message.performative == "inform":  # The KQML performative `tell` arrives as `inform`.
            moment.emit(eDone())


vocabulary = Vocabulary.of(*MESSAGES, *OUTSIDE, eStep, eDone, eOver, Buyer, Clerk)

WORLD = """
[world]
vocabulary = "spade_yard:vocabulary"
string = 'ABuyer#buyer · AClerk#clerk · AOutside#alice'
rate = 25
frames = 1800
until = "eOver"

[process.folk]
agents = ["spade_yard:Buyer", "spade_yard:Clerk"]

[process.outside]
agents = "minerva_messages:Outside"

[process.clock]
service = "each"
event = "eStep"

[process.xmpp]
service = "minerva_messages.spade:Spade"
speaks_for = "AOutside"
inside = ["buyer", "clerk"]
domain = "localhost"
server = "localhost:${port}"
register = true
password_env = "YARD_PASSWORD"
verify = false

[options]
port = 0
"""
