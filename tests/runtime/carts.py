"""Carts that a motor moves: each stores its own position and that of its body."""

from minerva_bus import Agent, Device, EventType, Generator, Metres, Primitive, Vocabulary, on, view
from minerva_bus.grammar.scene import FigureNode, walk

PPush = Primitive("PPush", who=str, push=Metres)
eStep, eBody = EventType("eStep"), EventType("eBody", x=Metres)
eShow = EventType("eShow", visual=True)


class Cart(Agent, symbol="ACart", rest=("push",)):
    """Computes its position in a frame from the push that the frame's view shows."""

    x: Metres = 0.0
    push: Metres = 0.0
    body: Metres = 0.0

    @on("eBody")
    def note(self, body, moment):
        self.body = body.x

    @on("eStep")
    def step(self, step, moment):
        self.x += self.push
        self.push = 1.0 + moment.random.random()

    @view("eShow")
    def show(self, event):
        return PPush(self.id, self.push)


class Clock(Generator, events=("eStep", "eShow")):
    def generate(self, tick):
        return [eStep(), eShow()]


class Motor(Device, Generator, draws=("eShow",), coupled=True, events=("eBody",)):
    """Pushes the bodies as a view specifies, and sends each cart the position of its body."""

    def __init__(self):
        self.bodies, self.push, self.carried_out = {}, {}, -1

    def show(self, shown):
        if shown.frame > self.carried_out:
            figures = [n for opens, n in walk(shown.scene) if opens and isinstance(n, FigureNode)]
            pushes = {node.parameters["who"]: node.parameters["push"] for node in figures}
            self.push = {n: 0.0 if n in shown.halted else push for n, push in pushes.items()}
            self.carried_out = shown.frame

    def generate(self, tick):
        for who, push in self.push.items():
            self.bodies[who] = self.bodies.get(who, 0.0) + push
        self.push = {}
        return [eBody(x, receivers=(who,)) for who, x in sorted(self.bodies.items())]

    def save(self):
        return {"bodies": dict(self.bodies), "carried_out": self.carried_out}

    def restore(self, saved):
        self.bodies, self.carried_out = dict(saved["bodies"]), saved["carried_out"]


vocabulary = Vocabulary.of(PPush, eStep, eBody, eShow, Cart)
