"""A contract net: one agent announces a job, and bidders propose a price or stay silent."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from minerva_bus import EventType, Vocabulary, on
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides
from minerva_messages import CONTRACT_NET, MESSAGES, Talker

eStep = EventType("eStep")


class Seller(Talker, symbol="ASeller"):
    """Calls all bidders in frame 1, awards the job to the cheapest and records the outcome."""

    bidders: int = 0
    limit: int = 5
    winner: str = ""
    price: float = 0.0
    awarded: int = -1
    silent: int = 0
    ended: str = ""

    @on("eStep")
    def step(self, step, moment):
        if moment.number == 1:
            to = [f"b{n}" for n in range(self.bidders)]
            self.open(moment, CONTRACT_NET, to, "job", reply_by=moment.number + self.limit)
        self.silent += len(self.expire(moment))
        bids = self.conversations(CONTRACT_NET)
        if not self.winner and bids and all(bid.state == "proposed" for bid in bids):
            best = min(bids, key=lambda bid: (float(bid.content), bid.peer))
            self.award(moment, bids, best)
            self.winner, self.price, self.awarded = best.peer, float(best.content), moment.number

    def received(self, message, conversation, moment):
        if conversation and conversation.over and message.sender == self.winner:
            self.ended = conversation.state


class Bidder(Talker, symbol="ABidder"):
    """Bids a random price `delay` frames after the call; a negative `delay` means never."""

    delay: int = 0
    since: int = -1
    lost: int = 0

    @on("eStep")
    def step(self, step, moment):
        for call in self.conversations(CONTRACT_NET, state="called"):
            if 0 <= self.delay <= moment.number - self.since:
                self.say(moment, call, "propose", f"{moment.random.random():.6f}")

    def received(self, message, conversation, moment):
        match message.performative:
            case "cfp":
                self.since = moment.number
            case "accept-proposal":
                self.say(moment, conversation, "inform", "done")
            case "reject-proposal":
                self.lost += 1


vocabulary = Vocabulary.of(*MESSAGES, eStep, Seller, Bidder)


def scene(options):
    """The seller and all bidders, one of which never replies and one too late."""
    text = f"ASeller#s<bidders={options['bidders']}>"
    slow = {0: -1, 1: 20}
    for number in range(options["bidders"]):
        text += f" · ABidder#b{number}<delay={slow.get(number, number % 3)}>"
    return text


WORLD = """
[world]
vocabulary = "extensions.messages.tests.auction:vocabulary"
scene = "extensions.messages.tests.auction:scene"
seed = 5
frames = 40
order = ["eMessage", "eStep"]

[options]
bidders = 100

[process.seller]
agents = "extensions.messages.tests.auction:Seller"

[process.bidders]
agents = "extensions.messages.tests.auction:Bidder"

[process.clock]
service = "each"
event = "eStep"
"""


@cache
def auction(processes=1, seed=5):
    """Digests by frame, strings and messages of a run."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "auction.toml"
        path.write_text(WORLD, encoding="utf-8")
        settings = (f"bidders.processes={processes}",)
        file = read_world_file(path, Overrides(settings=settings, seed=seed))
    algorithm = FrameAlgorithm(file.world)
    strings, messages = [], []

    def on_instruction(instruction):
        if isinstance(instruction, s.FrameDone):
            strings.append(algorithm.scene)
            messages.extend(
                (instruction.record.frame, event)
                for event in instruction.record.events
                if event.type == "eMessage"
            )

    runner = InProcessRunner(
        algorithm, [process.make_member() for process in file.processes], on_instruction
    )
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())
    return strings, messages
