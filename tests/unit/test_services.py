"""Services: declarations of their classes, options, and when they take part."""

from dataclasses import dataclass
from inspect import Parameter, signature
from types import SimpleNamespace
from typing import Any

import hypothesis.strategies as st
import pytest
from hypothesis import given

from minerva_bus import Context, Device, Event, Frame, Generator, user_code
from minerva_bus.entry_points import entries
from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.frame.member_side import Member
from minerva_bus.launch.process_specs import ProcessSpec, forgotten
from minerva_bus.launch.specs import Factory, find_service
from minerva_bus.launch.world_files import idle
from minerva_bus.world.services import Participation, Tick, When, when_of
from minerva_services.options import grouped, takes_options


class Rain(Generator, events=("eRain",)):
    def generate(self, tick):
        yield Event("eRain")


class Free(Rain, when="freely"):
    pass


class Screen(Device, draws=("eDraw",), coupled=True):
    def show(self, view): ...


def test_a_class_declares_what_it_generates_and_draws():
    assert (Rain().generates(), Rain.when) == (("eRain",), "")
    assert (Free().generates(), Free.when) == (("eRain",), "freely")
    assert (Screen.draws, Screen.coupled, Screen.when) == (("eDraw",), True, "")
    assert (Device.draws, Device.coupled) == ((), False)


def test_one_event_type_is_not_its_letters():
    with pytest.raises(MisuseError, match=r'Bad: events are several, write events=\("eRain",\)'):

        class Bad(Generator, events="eRain"):
            pass

    with pytest.raises(MisuseError, match="draws are several"):

        class Worse(Device, draws="eDraw"):
            pass


class Reader(Rain):
    def __init__(self):
        self.number, self.path, self.rows, self.pictures = 0, "rain.txt", {}, 0

    def generate(self, tick):
        self.number += 1
        self._keep(self.number, self.path)
        return super().generate(tick)

    def _keep(self, number, path):
        self.rows[number] = path

    def show(self, view):
        self.pictures += 1


class Saving(Reader):
    def save(self):
        return self.number


def test_a_generator_that_changes_and_saves_nothing_is_named():
    made = {"reader": Reader, "saving": Saving, "rain": Rain, "free": Free, "screen": Screen}
    processes = [ProcessSpec(name, Factory(cls, {}, name)) for name, cls in made.items()]
    lost = "changes number, rows and has no `save`; it begins again"
    line = f"Reader of [process.reader] {lost} (docs/howto/resume.md)"
    assert list(forgotten(processes)) == [line]


def test_the_installed_services_save_what_they_change_and_waste_no_statement(monkeypatch):
    # Without their constructors, which need options.
    classes = {name: entry.load() for name, entry in entries("minerva.services").items()}
    processes = [ProcessSpec(name, SimpleNamespace(cls=cls)) for name, cls in classes.items()]
    assert not list(forgotten(processes))
    monkeypatch.setattr(user_code, "_SHIPPED", ())  # A start does not read them.
    idle.cache_clear()
    assert not [line for cls in classes.values() for line in idle(cls)]


@pytest.mark.parametrize("events", [3, "eRain", {"a": 1}, (3,), None])
def test_an_option_overrides_the_default_of_a_service(events):
    class Shower(Rain):
        def __init__(self, events: Any = 1):
            self.events = events

    explained = (
        r"Shower: self.events must be a tuple of names, not .*;"
        " call an attribute for something else, as an option's value, otherwise"
    )
    make = Factory(Shower, {"events": events}, "shower")
    with pytest.raises(WorldFileError, match=f"^shower: {explained}"):
        make()
    with pytest.raises(MisuseError, match=f"^{explained}"):
        Member("shower", Shower(events))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("when", 10), ("when", None), ("takes", "last"), ("nth", 0), ("pulse_every", "1"),
    ],
)  # fmt: skip
def test_an_attribute_that_is_not_what_a_member_expects_is_an_error(name, value):
    class Screen(Device, draws=("eDraw",)):
        def show(self, view):
            pass

    screen = Screen()
    setattr(screen, name, value)
    with pytest.raises(MisuseError, match=f"^Screen: self.{name} must be .*, not "):
        Member("screen", screen)


def test_an_option_may_permit_it():
    class Shower(Rain):
        def __init__(self, events: str = "eRain"):
            self.events = tuple(events.split(","))

    class Told(Shower):
        def __init__(self, events: int = 3):
            self.events = events

        def generates(self):
            return ("eRain",) * self.events

    shower = Factory(Shower, {"events": "eRain,eHail"}, "shower")()
    assert Member("shower", shower).hello().generates == ("eRain", "eHail")
    assert Member("told", Told(1)).hello().generates == ("eRain",)


@pytest.mark.parametrize("name", ["draws", "topics", "publishes"])
def test_so_of_a_device(name):
    screen = Screen()
    setattr(screen, name, "eDraw")
    with pytest.raises(MisuseError, match=f"Screen: self.{name} must be a tuple of names"):
        Member("screen", screen)


def test_a_tick_is_a_moment_of_a_generator():
    tick = Tick(Frame(3, dt=0.5, seed=1), "rain")
    assert (tick.number, tick.dt, tick.time) == (3, 0.5, 1.5)
    tick.emit(Event("eRain", sender="a"))
    assert tick.emitted == [Event("eRain", sender="a")]


def test_an_agent_emits_in_its_own_name():
    moment = Context(Frame(), "#a")
    moment.emit(Event("eRain", sender="someone else"))
    assert moment.emitted == [Event("eRain", sender="a")]


@pytest.mark.parametrize(
    ("bases", "argument", "problem"),
    [
        ((Generator,), "event", "Odd has the unknown class argument event; did you mean 'events'?"),
        ((Generator,), "generates", "generates; it may have events, when"),
        ((Generator,), "draws", "draws; it may have events, when"),
        ((Device,), "every", "every; it may have draws, coupled, when"),
        ((Generator, Device), "draw", "draw; did you mean 'draws'?"),
    ],
)
def test_an_unknown_argument_is_named(bases, argument, problem):
    with pytest.raises(MisuseError) as caught:
        type("Odd", bases, {}, **{argument: ("eHonk",)})
    assert problem in str(caught.value)


@pytest.mark.parametrize(
    ("base", "name", "argument", "attribute"),
    [
        (Generator, "when", "freely", "in step"),
        (Device, "when", "at 20 Hz", "at 5 Hz"),
        (Generator, "events", ("eHonk",), ("eRing",)),
        (Device, "draws", ("eShow",), ("ePicture",)),
        (Device, "coupled", True, False),
    ],
)
def test_an_argument_is_not_an_attribute_of_the_body_too(base, name, argument, attribute):
    with pytest.raises(MisuseError) as caught:
        type("Odd", (base,), {name: attribute}, **{name: argument})
    assert str(caught.value) == (
        f"Odd: {name} is given twice, as the class argument {name}={argument!r} and in the body,"
        f" {name} = {attribute!r}; remove one of them"
    )


def test_another_base_class_may_have_arguments():
    class Tagged:
        tag = ""

        def __init_subclass__(cls, tag="", **rest):
            super().__init_subclass__(**rest)
            cls.tag = tag

    for bases in ((Generator, Tagged), (Tagged, Generator)):
        made = type("Odd", bases, {}, tag="a", events=("eHonk",))
        assert (made.tag, made.events) == ("a", ("eHonk",))


@dataclass(frozen=True)
class Position:
    where: str
    level: int = 0
    hidden: float = 1.0


@dataclass(frozen=True)
class Size:
    width: float = 2.0


class Board:
    @takes_options(Position, Size, without=("hidden",))
    def __init__(self, name: str, width: int = 3, **further):
        self.name, self.width = name, width
        self.place, _ = grouped(further, Position, Size)


def test_the_signature_lists_own_options_then_those_of_the_groups():
    parameters = signature(Board.__init__).parameters
    assert list(parameters) == ["self", "name", "width", "where", "level"]
    assert parameters["where"].default is Parameter.empty
    assert (parameters["level"].default, parameters["level"].annotation) == (0, int)


def test_groups_are_created_from_their_own_options():
    assert grouped({"where": "hall", "width": 1.0}, Position, Size) == (Position("hall"), Size(1.0))
    assert Board("b", where="hall", level=2).place == Position("hall", 2)


def test_an_option_of_no_group_is_an_error():
    with pytest.raises(TypeError, match="unknown options: wide"):
        Board("b", where="hall", wide=1)


@pytest.mark.parametrize(
    ("service", "options", "problem"),
    [
        ("sprites", {"widht": 3}, "no option 'widht'; did you mean 'width'"),
        ("opengl", {"fps": "many"}, "fps must be a number"),
        ("mqtt", {"broker": "b", "user": 3}, "user must be a"),
        ("ros2_robot", {"router": "tcp/h:1", "near": "far"}, "near must be a number"),
        ("markers", {"size": 0.2}, "needs the option 'dictionary'"),
    ],
)
def test_world_files_are_checked_against_the_groups(service, options, problem):
    with pytest.raises(WorldFileError, match=problem):
        Factory(find_service(service), options, "member")


TIMES = {
    "": When(),
    "in step": When(Participation.IN_STEP),
    "on orders": When(Participation.ON_ORDERS),
    "freely": When(Participation.FREELY),
    "each frame": When(every=1),
    "each 10 frames": When(every=10),
    "at 25 Hz": When(rate=25.0),
    "at 0.001 Hz": When(rate=0.001),
    "freely, each 2 frames": When(Participation.FREELY, every=2),
    "in step, at 29.97002997 Hz": When(Participation.IN_STEP, rate=29.97002997),
}


@pytest.mark.parametrize("text", TIMES)
def test_a_text_and_its_value(text):
    assert When.read(text) == TIMES[text]
    assert str(TIMES[text]) == text


def test_other_texts_have_the_same_value():
    assert When.read("each 1 frames") == When(every=1)
    assert When.read("each 5 frames, in step") == When(Participation.IN_STEP, every=5)


@given(st.sampled_from(Participation), st.floats(0, allow_infinity=False, exclude_min=True))
def test_a_rate_keeps_every_bit(asked, rate):
    assert When.read(str(When(asked, rate=rate))).rate == rate


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "lockstep",
            '"lockstep" is not possible; it may have "in step", "on orders", "freely", "ea',
        ),
        ("each 5 frame", '"each 5 frame" is not possible'),
        ("freely,each frame", "is not possible"),
        ("each frame, ", '"" is not possible'),
        ("at -1 Hz", '"at -1 Hz" is not possible'),
        ("at inf Hz", '"at inf Hz" is not possible'),
        ("at 1e999 Hz", 'expected a number above 0 in "at 1e999 Hz"'),
        ("at 0 Hz", 'expected a number above 0 in "at 0 Hz"'),
        ("each 0 frames", 'expected a number above 0 in "each 0 frames"'),
        ("in step, freely", 'choose one of "in step" and "freely"'),
        ("at 5 Hz, each 2 frames", 'choose one of "at 5 Hz" and "each 2 frames"'),
    ],
)
def test_what_is_not_possible(text, problem):
    with pytest.raises(MisuseError) as caught:
        When.read(text)
    assert str(caught.value).startswith(f'when = "{text}": ')
    assert problem in str(caught.value)


class Shower(Generator, events=("eRain",)):
    pass


class Picture(Device, draws=("eShow",)):
    def show(self, view):
        pass


class Both(Picture, Shower):
    pass


@pytest.mark.parametrize(
    ("cls", "declared", "when"),
    [
        (Shower, "", "in step"),
        (Shower, "freely", "freely"),
        (Shower, "on orders", "on orders"),
        (Shower, "each 3 frames", "in step, each 3 frames"),
        (Picture, "", ""),
        (Picture, "at 20 Hz", "at 20 Hz"),
        (Both, "", "in step"),
        (Both, "each 5 frames", "in step, each 5 frames"),
        (Both, "freely, each frame", "freely, each frame"),
    ],
)
def test_a_generator_is_in_step_unless_it_says_otherwise(cls, declared, when):
    made = type("Made", (cls,), {}, when=declared)()
    assert str(when_of(made)) == when
    assert str(Member("made", made).hello().when) == when


@pytest.mark.parametrize(
    ("cls", "when", "problem"),
    [
        (Picture, "on orders", 'when = "on orders" is for generators, and it is a device'),
        (Picture, "in step, each frame", "is for generators, and it is a device"),
        (Shower, "at 5 Hz", 'its `when` is "in step, at 5 Hz", but it draws no views'),
        (Shower, "freely, each frame", "but it draws no views and is not in step"),
        (Both, "on orders", "so it has events on orders only, but it draws views"),
    ],
)
def test_times_that_a_service_cannot_have(cls, when, problem):
    made = type("Made", (cls,), {}, when=when)()
    with pytest.raises(MisuseError) as caught:
        Member("made", made)
    assert str(caught.value).startswith("Made: ")
    assert problem in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("topics", ("sight",), "subscribes to topics"),
        ("publishes", ("sight",), "publishes on topics"),
        ("takes_orders", lambda self: ("eRain",), "takes orders"),
    ],
)
def test_a_generator_that_is_not_always_asked_has_no_inputs(name, value, reason):
    made = type("Made", (Shower,), {name: value}, when="each 2 frames")()
    with pytest.raises(MisuseError, match=f"so some frames do not ask it, but it {reason}"):
        Member("made", made)


@pytest.mark.parametrize("when", ["often", 5])
def test_a_class_argument_is_checked_at_once(when):
    with pytest.raises(MisuseError, match=r"^Odd: when"):
        type("Odd", (Shower,), {}, when=when)


class Torn(Generator, events=("eRain",)):
    """A generator whose file is gone when its process starts again."""

    def __init__(self):
        raise FileNotFoundError("lines.txt")

    def generate(self, tick):
        self.read = tick.number


def test_what_a_service_forgets_is_known_without_making_one():
    (line,) = forgotten([ProcessSpec("torn", Factory(Torn, {}, "torn"))])
    assert line.startswith("Torn of [process.torn] changes read and has no `save`")
