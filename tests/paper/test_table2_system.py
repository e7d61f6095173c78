"""Table 2: the system algorithm, on a small world and in the paper's own words."""

from minerva_bus import EMPTY, Agent, EventType, Metres, Primitive, Vocabulary, on, view
from minerva_bus.grammar.scene import scene_of
from minerva_bus.testing import transcription
from minerva_bus.world.evolution import evolve
from minerva_bus.world.moment import Frame, Moment
from minerva_bus.world.order import Order, collect
from minerva_bus.world.views import visualize

PFox = Primitive("PFox", x=Metres)
eStep = EventType("eStep")
eDie = EventType("eDie")
eDraw = EventType("eDraw", visual=True)


class Fox(Agent, symbol="AFox"):
    x: Metres = 0.0

    @on("eStep")
    def step(self, event, moment):
        self.x += 1.0

    @on("eDie")
    def die(self, event, moment):
        return EMPTY

    @view("eDraw")
    def picture(self, event):
        return PFox(self.x)


VOCABULARY = Vocabulary.of(PFox, eStep, eDie, eDraw, Fox)
W0 = VOCABULARY.read("AFox#a · AFox#b<x=10>")


def g_step(t):
    return [eStep()]


def g_die(t):
    return [eDie(receivers=["a"])] if t == 1 else [eDie()] if t == 3 else []


def g_draw(t):
    return [eDraw()]


GENERATORS = [g_step, g_die, g_draw]


def lam(agent, event):
    if event.type not in Fox.activities or (event.receivers and agent.id not in event.receivers):
        return scene_of(agent)
    fox = Fox.thaw(agent)
    result = Fox.activities[event.type](fox, event, Moment(Frame(), f"#{agent.id}"))
    return fox.string if result is None else result


def theta(agent, event):
    return Fox.views[event.type](Fox.thaw(agent), event)


def run():
    shown = []
    frames = transcription.system(
        W0, GENERATORS, lambda event: event.type == "eDraw", lam, theta, shown.append
    )
    return list(frames), shown


def test_the_string_of_every_frame():
    frames, _ = run()
    assert [str(w) for w in frames] == [
        "AFox#a<x=0>() · AFox#b<x=10>()",
        "AFox#a<x=1>() · AFox#b<x=11>()",
        "AFox#b<x=12>()",
        "AFox#b<x=13>()",
    ]


def test_steps_5_and_6_read_the_same_string():
    """Frame t's view shows w_t, and not w_next: the first picture is that of w_0."""
    frames, shown = run()
    for w, v in zip(frames, shown, strict=True):
        assert v == visualize(w, [eDraw()], [Fox])
    assert str(shown[0]) == "PFox<x=0> · PFox<x=10>"


def test_step_9_ends_when_nothing_is_left():
    frames, shown = run()
    assert len(frames) == len(shown) == 4
    assert frames[-1] != EMPTY


def test_the_empty_world_is_run_once():
    """Step 9 stands at the end: even w_0 = ε has its frame."""
    frames = transcription.system(
        EMPTY, GENERATORS, lambda event: False, lam, theta, lambda v: None
    )
    assert list(frames) == [EMPTY]


def test_the_engines_functions_make_the_same_frames():
    order = Order(("eStep", "eDie", "eDraw"))
    w, frames, shown = W0, [], []
    for t in range(4):
        frames.append(w)
        sources = {g.__name__: g(t) for g in GENERATORS}
        events = collect(order, sources)
        e_v = [event for event in events if event.type == "eDraw"]
        e_u = [event for event in events if event.type != "eDraw"]
        w_next = evolve(w, e_u, [Fox], Frame(t)).scene
        shown.append(visualize(w, e_v, [Fox], t))
        w = w_next
    assert (frames, shown) == run()
    assert w == EMPTY
