"""Spaces in worlds: one string, wherever they run."""

import space_worlds as worlds
from space_worlds import Flock, Meadow, eStep, graze, grow, hunt, meadow

from minerva_bus import Vocabulary, World, each, on, run
from minerva_bus.launch.process_specs import ProcessSpec, compile_agents
from minerva_fast import Space, driving, interpreted, rules
from minerva_fast.space import rules_of

FLOCK = ProcessSpec("flock", agents=(Flock,))


def world(agents):
    string = meadow(name="north").string + meadow(sheep=20, name="south").string
    return World(string, agents=agents, services=[each(eStep)], name="meadows", seed=7)


def test_a_run_in_processes_gives_the_string_of_a_run_in_one():
    here = run(world([Meadow]), frames=5)
    there = run(world({"a": [Meadow], "b": [Meadow]}), frames=5, bus=True)
    assert there.digest == here.digest
    assert run(world([Meadow]), frames=4).digest != here.digest


def test_a_space_is_written_and_read_as_text():
    space = meadow(side=2, sheep=1, wolves=0).string
    assert Vocabulary.of(Meadow, eStep).read(str(space)).digest == space.digest


RULES = (hunt, [grow])


def grazing(space, moment):
    space.run(moment, graze)


class Renamed(Space, symbol="ARenamed"):
    @on("eStep")
    def step(self, step, moment):
        self.run(moment, worlds.look)
        grazing(self, moment)

    def also(self, moment):
        self.run(moment, *RULES)


def test_rules_are_found_by_name_in_modules_tuples_and_functions():
    assert rules_of(Meadow) == [graze, hunt, grow]
    assert set(rules_of(Renamed)) == {graze, hunt, grow, worlds.look}
    assert rules_of(Space) == []


def test_rules_are_compiled_before_the_first_frame(monkeypatch):
    compiled, shown = [], []
    for module in (driving, rules):
        monkeypatch.setattr(module, "load_kernel", lambda text, _: compiled.append(text) or len)
    with interpreted():
        compile_agents([FLOCK])
    assert compiled == []
    compile_agents([FLOCK], lambda *line: shown.append(line))
    for name in ("drift, a rule", "look, a rule", "'locate'"):
        assert any(name in text for text in compiled)
    names = [title for _, _, _, title in shown]
    assert "drift of Flock" in names
    assert [done for _, done, _, _ in shown] == list(range(len(shown)))
