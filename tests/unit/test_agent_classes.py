"""Classes of agents: valid and invalid declarations."""

import re
from dataclasses import replace
from functools import partialmethod, wraps
from typing import ClassVar

import numpy as np
import pytest

from minerva_bus import (
    EMPTY,
    Agent,
    Cells,
    Default,
    EventType,
    Metres,
    Vocabulary,
    evolve,
    on,
    parse,
    view,
)
from minerva_bus.errors import MinervaError, MisuseError, VocabularyError
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.scene import AGENT_ID, scene_of
from minerva_bus.world.agent import ActivityError, kinds_of
from minerva_bus.world.class_declaration import NotCompilable

eHit = EventType("eHit")
eStep = EventType("eStep")


class Fox(Agent, symbol="AFox"):
    SPEED: ClassVar[float] = 2.0
    x: Metres
    energy: float = 10.0
    births: int = 0
    _cache: int = 0
    note = "no annotation, no state"

    @on("eHit", "eStep")
    def either(self, event, moment):
        self.energy -= 1.0


def test_annotations_are_the_state():
    assert Fox.kind.name == "AFox"
    assert Fox.kind.fields.names == ("x", "energy", "births")
    assert [str(field.type) for field in Fox.kind.fields.all] == ["real m", "real", "int"]
    assert Fox.kind.subscribes == {"eHit", "eStep"}


def test_an_agent_is_a_string():
    assert str(Fox("a", x=1).string) == "AFox#a<x=1, energy=10, births=0>()"
    assert repr(Fox("a", x=1)) == "AFox#a<x=1, energy=10, births=0>()"
    assert str(Fox("a", x=1, scope=parse("PA")).string).endswith("(PA)")


def by_super(self, number):
    super(Fox, self).__init__(f"fox-{number}", x=number)


def by_name(self, number):
    Agent.__init__(self, f"fox-{number}", x=number)


@wraps(by_name)
def wrapped(*args):
    by_name(*args)


@pytest.mark.parametrize("init", [by_super, by_name, wrapped, partialmethod(by_name)])
def test_a_class_may_have_a_shorter_constructor_that_calls_that_of_agent(init):
    class Short(Fox, symbol="AFox"):
        __init__ = init

    assert str(Short(3).string) == str(Fox("fox-3", x=3).string)


@pytest.mark.parametrize("other", [lambda self: None, partialmethod(lambda self: None)])
def test_another_constructor_is_refused(other):
    with pytest.raises(MisuseError, match=r"Short.__init__ would not be called for agents of a"):
        type("Short", (Fox,), {"__init__": other}, symbol="AFox")


def test_thaw_and_freeze_give_the_very_node():
    node = Fox("a", x=1).freeze()
    agent = Fox.thaw(node)
    assert agent.freeze() is node
    agent.energy = 10
    assert agent.freeze() is node
    agent.energy = 9
    assert agent.freeze() is not node


def test_a_node_that_an_agent_has_made_fits_but_not_one_made_from_it():
    vocabulary, agent = Vocabulary.of(eHit, eStep, Fox), Fox.thaw(Fox("a", x=1).freeze())
    agent.energy = 9
    node = agent.freeze()
    assert node.values == (1.0, 9.0, 0)
    assert vocabulary.check(scene_of(node)).nodes[0] is node
    for values, said in (((1.0, float("nan"), 0), "finite number"), ((1.0,), "one value for each")):
        with pytest.raises(VocabularyError, match=said):
            vocabulary.check(scene_of(replace(node, values=values)))
    agent.energy, agent.x = float("nan"), 1
    with pytest.raises(MinervaError, match=r"AFox#a: energy must be a finite number"):
        agent.freeze()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Fox("a"), r"AFox#a needs a value for x \(real m\)"),
        (lambda: Fox("a", x="far"), "AFox#a: x must be a number in m, not 'far'"),
        (lambda: Fox("a", x=1, enrgy=2), "did you mean 'energy'"),
        (lambda: Fox("", x=1), "'' is not a valid agent id"),
        (lambda: Fox("a b", x=1), "'a b' is not a valid agent id"),
        (lambda: Fox("-a", x=1), "'-a' is not a valid agent id"),
        (lambda: on(), "name the event types"),
        (lambda: on(lambda self: None), "name the event types"),
        (lambda: view(eHit), "name the event types"),
        (lambda: kinds_of([Agent]), "Agent has no symbol"),
        (lambda: kinds_of([Fox, type("Fox2", (Agent,), {}, symbol="AFox")]), "two classes"),
    ],
)
def test_misuse(make, said):
    with pytest.raises(MisuseError, match=said):
        make()


def test_the_docstring_names_the_characters_of_ids():
    (line,) = [line for line in Agent.__doc__.splitlines() if line.strip().startswith("id:")]
    named = re.search(r"`(.*?)`", line)[1].split()
    allowed = [c for c in map(chr, range(33, 127)) if AGENT_ID.fullmatch(f"a{c}")]
    assert [c for c in allowed if not c.isalnum()] == sorted(named)


def test_an_invalid_agent_can_still_be_shown_in_a_debugger():
    fox = Fox("a", x=1)
    fox.x = "far"
    assert repr(fox).startswith("<AFox#a, not valid: AFox#a: x must be")


def classes(**annotations):
    return type("Bad", (Agent,), {"__annotations__": annotations}, symbol="ABad")


@pytest.mark.parametrize(
    "name", ["id", "scope", "kind", "string", "views", "activities", "child", "freeze", "writable"]
)
def test_names_that_every_agent_has_are_taken(name):
    with pytest.raises(MisuseError, match=f"Bad.{name} is taken"):
        classes(**{name: int})


def test_attributes_have_types_of_the_language():
    with pytest.raises(MisuseError, match="not a parameter type"):
        classes(x=dict)


def test_one_method_for_one_event_type():
    with pytest.raises(MisuseError, match="two methods for eHit: one and two"):

        class Bad(Agent, symbol="ABad"):
            @on("eHit")
            def one(self, event, moment): ...

            @on("eHit", "eStep")
            def two(self, event, moment): ...


class Base(Agent):
    n: int = 0

    @on("eHit")
    def hit(self, event, moment):
        self.n += 1


class Plain(Base, symbol="APlain"):
    pass


class Overridden(Base, symbol="AOverridden"):
    def hit(self, event, moment):
        self.n += 10


class Instead(Base, symbol="AInstead"):
    @on("eHit")
    def other(self, event, moment):
        self.n += 100


class Moved(Base, symbol="AMoved"):
    @on("eStep")
    def hit(self, event, moment):
        self.n += 1000


class Deaf(Base, symbol="ADeaf"):
    hit = None


class More(Plain):
    m: int = 0

    @on("eStep")
    def step(self, event, moment):
        self.m += 1


@pytest.mark.parametrize(
    ("cls", "hit", "step"),
    [(Plain, 1, 0), (Overridden, 10, 0), (Instead, 100, 0), (Moved, 0, 1000), (Deaf, 0, 0)],
)
def test_inheritance(cls, hit, step):
    w = cls("a").string
    assert evolve(w, [eHit()], [cls]).scene.nodes[0].state["n"] == hit
    assert evolve(w, [eStep()], [cls]).scene.nodes[0].state["n"] == step


def test_a_subclass_without_a_symbol_is_of_the_same_kind_with_what_it_adds():
    assert More.kind.name == "APlain"
    assert More.kind.fields.names == ("n", "m")
    assert More.kind.subscribes == {"eHit", "eStep"}
    assert Plain.kind.fields.names == ("n",)


class Sterile(Agent, symbol="ASterile"):
    births: float = 0.0


def test_births_must_be_declared():
    for barren in (Plain("a"), Sterile("a")):
        with pytest.raises(MisuseError, match="declare `births: int = 0`"):
            barren.child()


def test_children_get_ids_from_their_parent():
    fox = Fox("a", x=1)
    first, second = fox.child(x=2), fox.child(Plain, n=3)
    assert str(first + second) == "AFox#a:1<x=2, energy=10, births=0>() · APlain#a:2<n=3>()"
    assert fox.births == 2


def test_the_id_of_a_long_lineage_stays_short_and_its_own():
    fox, ids = Fox("adam", x=0), set()
    for _ in range(200):
        brother = fox.child(x=0)
        (sister,) = fox.child(x=0).nodes
        ids |= {brother.nodes[0].id, sister.id}
        fox = Fox.thaw(sister)
    assert len(ids) == 400
    assert max(map(len, ids)) <= 64
    assert parse(str(fox.string)) == fox.string


class Painter(Agent, symbol="APainter"):
    grid: Cells = np.zeros((2, 2), np.int16)
    kept: ClassVar[list] = []

    @on("eHit")
    def paint(self, event, moment):
        grid = self.writable("grid")
        grid[0, 0] += 1
        self.kept.append(grid)
        self.kept.append(grid[0])

    @on("eStep")
    def repaint(self, event, moment):
        self.grid[0, 0] = 9


def test_user_code_cannot_change_a_matrix_of_the_string():
    w = Vocabulary.of(eHit, eStep, Painter).read("APainter#p")
    after = evolve(w, [eHit(), eHit()], [Painter]).scene
    text = str(after)
    assert "grid=2x2[2 0*3]" in text
    for array in Painter.kept:
        array[...] = 77
    assert str(after) == text
    assert "grid=2x2[0*4]" in str(w)


def test_a_matrix_is_written_to_through_writable_only():
    w = Painter("p").string
    with pytest.raises(Exception, match="read-only"):
        evolve(w, [eStep()], [Painter])


def test_a_default_matrix_is_not_the_one_in_the_class():
    Painter.grid[0, 0] = 5
    assert "grid=2x2[0*4]" in str(Painter("p").string)


def test_mixins_need_no_symbol():
    assert not hasattr(Base, "kind")
    assert Base.activities.keys() == {"eHit"}
    assert evolve(EMPTY, [eHit()], [Plain]).scene == EMPTY


def test_kinds_with_matrix_defaults_can_be_compared():
    def kind(cells):
        return Field.of("grids", Default(tuple[Cells, ...], (np.array(cells, np.int16),)))

    assert kind([[1, 2]]) == kind([[1, 2]])
    assert kind([[1, 2]]) != kind([[1, 3]])
    assert kind([[1, 2]]) != Field.of("grids", tuple[Cells, ...])


class Herdsman(Agent, symbol="AHerdsman"):
    """Modifies its population as the event requests."""

    x: Metres = 1.0
    n: int = 0
    deed: str = ""

    @on("eDo", population=True)
    def do(self, order, moment):
        return DEEDS[order.deed](self, moment)


eDo = EventType("eDo", deed=str)
DEEDS = {
    "length": lambda herd, moment: setattr(herd, "x", np.ones(9)),
    "type": lambda herd, moment: setattr(herd, "n", herd.n * 1.5),
    "infinite": lambda herd, moment: setattr(herd, "x", np.where(herd.x > 2, np.inf, herd.x)),
    "stranger": lambda herd, moment: setattr(herd, "y", 1),
    "id": lambda herd, moment: setattr(herd, "id", "b"),
    "mask": lambda herd, moment: herd.die(herd.x),
    "births": lambda herd, moment: herd.bear(),
    "stream": lambda herd, moment: moment.random,
    "events": lambda herd, moment: moment.emit(eDo(np.array(["a", "b"], object))),
    "returned": lambda herd, moment: EMPTY,
}


@pytest.mark.parametrize(("deed", "said"), [
    ("length", r"#a0 .*x must be an array of shape \(3,\), not \(9,\)"),
    ("type", "n must be an array of int, not of float64"),
    ("infinite", "of AHerdsman#a2 .*x must be a finite number, not (inf|nan)"),
    ("stranger", "has no y; declare it"),
    ("id", "an agent keeps its id"),
    ("mask", r"a mask is an array of bool, shape \(3,\), not float64 \(3,\)"),
    ("births", "declare `births: int = 0`"),
    ("stream", "a population draws from moment.chance"),
    ("events", "2 events from 3 agents"),
    ("returned", r"returns nothing: self.die\(mask\)"),
])  # fmt: skip
def test_an_error_in_a_population_names_agent_event_and_frame(deed, said):
    herd = Herdsman.many("a", 3, x=np.array([1.0, 2.0, 3.0]))
    with pytest.raises(ActivityError, match=said) as caught:
        evolve(herd, [eDo(deed)], [Herdsman])
    assert f'eDo<deed="{deed}">' in str(caught.value)
    assert "in frame 0" in str(caught.value)


def test_a_series_of_a_table_is_an_array():
    class Series:
        """What pandas and polars have in common."""

        shape = (2,)

        def __array__(self, dtype=None, copy=None):
            return np.array([1.0, 2.0])

    herd = Herdsman.many("a", 2, x=Series())
    assert [node.state["x"] for node in herd.nodes] == [1.0, 2.0]


def test_the_dead_may_be_infinite():
    DEEDS["dies"] = lambda herd, moment: (
        (
            setattr(herd, "x", np.where(herd.x > 2, np.inf, herd.x)),
            herd.die(herd.x > 2),
        )[2:]
        or None
    )
    mortals = Herdsman.many("a", 3, x=np.array([1.0, 2.0, 3.0]))
    assert len(evolve(mortals, [eDo("dies")], [Herdsman]).scene) == 2


def test_a_kind_with_a_matrix_cannot_be_written_for_populations():
    with pytest.raises(MisuseError, match="grid is a cells"):

        class Mapper(Agent, symbol="AMapper"):
            grid: Cells = np.zeros((1, 1), np.int16)

            @on("eDo", population=True)
            def do(self, order, moment): ...


def test_without_an_accelerator_compiled_methods_say_what_they_need(monkeypatch):
    monkeypatch.setattr("minerva_bus.world.class_declaration.entries", lambda group: {})

    def walker(mode):
        class Walker(Agent, symbol="AWalker"):
            @on("eStep", compiled=mode)
            def walk(self, step, moment):
                pass

        return Walker

    needs = r"Walker\.walk cannot be compiled: no accelerator is installed; add the extension fast"
    with pytest.raises(NotCompilable, match=needs):
        walker(True)
    with pytest.warns(UserWarning, match=needs):
        assert walker("if possible").accelerator is None
    assert walker(False).accelerator is None
