"""Saved values of services survive a record, the journal and the restart of the service."""

import os
import signal
from functools import partial

import pytest
from running import World, ends_as_alone, eventually, here, minerva, summary, write_world

CODE = '''\
from minerva_bus import Agent, EventType, Generator, Vocabulary, on

eCount = EventType("eCount", count=int)


class Adder(Agent, symbol="AAdder"):
    total: float = 0.0

    @on("eCount")
    def add(self, told, moment):
        self.total = self.total / 1.01 + told.count


FORMS = {
    "whole": (int, lambda n: n),
    "number": (float, lambda n: n / 2),
    "text": (str, str),
    "bytes": (bytes, lambda n: bytes([n])),
    "list": (list, lambda n: [n, [str(n)]]),
    "tuple": (list, lambda n: (n, None)),
    "mapping": (dict, lambda n: {"count": n, "of": {"more": [n]}}),
    "value": (dict, lambda n: {"=": n}),
    "empty": (dict, lambda n: {} if n == 2 else {"=": n, "": n}),
    "nothing": (int, lambda n: n or None),
    "zero": (int, lambda n: n - 1),
}


class Keeper(Generator, events=("eCount",)):
    """Counts 0, 1, 2, 0, ...; what it saves has the count in the form that is wanted."""

    def __init__(self, form: str) -> None:
        self.kind, self.form = FORMS[form]
        self.count = 0

    def generate(self, tick):
        self.count = (self.count + 1) % 3
        return eCount(count=self.count)

    def save(self):
        return self.form(self.count)

    def restore(self, saved):
        assert type(saved) is self.kind
        again = [n for n in range(3) if plain(self.form(n)) == saved]
        (self.count,) = again


def plain(value):
    return list(value) if isinstance(value, tuple) else value


vocabulary = Vocabulary.of(eCount, Adder)
'''

FORMS = (
    "whole", "number", "text", "bytes", "list", "tuple", "mapping", "value", "empty", "nothing",
    "zero",
)  # fmt: skip


def keepers(folder, forms=FORMS, **world):
    """A world with a keeper for each form."""
    members = '[process.adders]\nagents = "keeping:Adder"\n' + "".join(
        f'[process.{form}]\nservice = "keeping:Keeper"\nform = "{form}"\n' for form in forms
    )
    path = write_world(folder, members, string="AAdder#a", **world)
    path.write_text(path.read_text().replace("yard:vocabulary", "keeping:vocabulary"))
    (folder / "keeping.py").write_text(CODE)
    return path


def others(world, forms, before):
    """Whether all of these processes have been replaced."""
    now = world.runs(*forms)
    return all(now[form] != before[form] for form in forms)


def alone(folder, *words):
    return summary(here(folder, "run", *words, "--in-process", "--json"))


@pytest.mark.parametrize("frames", [1, 2, 3, 7])
def test_a_record_gives_back_what_was_saved(frames, tmp_path):
    pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")
    path = keepers(tmp_path, frames=12)
    whole = alone(tmp_path, path)
    alone(tmp_path, path, "--frames", frames, "--record", "cut.mcap")
    done = alone(tmp_path, "--resume", "cut.mcap", "--frames", 12, "--record", "on.mcap")
    assert done["digest"] == whole["digest"]


def test_the_journal_gives_back_what_was_saved(tmp_path):
    forms = ("whole", "text", "list", "value", "nothing")
    # It runs until it is stopped, because a world at its last frame restarts nobody.
    path = keepers(tmp_path, forms, frames=10**6, rate=50)
    with World(path) as world:
        for _ in range(2):
            before = world.runs("adders", *forms)
            world.kill_coordinator()
            for form in forms:
                os.kill(before[form], signal.SIGKILL)
            eventually(partial(others, world, forms, before), "they restart")
        ends_as_alone(world)
    assert "a successor continues from its journal" in world.text


ODD = """\
from minerva_bus import Agent, EventType, Generator, Vocabulary, on

eCount = EventType("eCount", count=int)


class Adder(Agent, symbol="AAdder"):
    @on("eCount")
    def add(self, told, moment):
        pass


class Odd(Generator, events=("eCount",)):
    def __init__(self, what: str, value: str) -> None:
        self.what, self.value = what, value

    def generate(self, tick):
        return eCount(count=1)

    def save(self):
        return {"odd": eval(self.value)} if self.what == "save" else None

    def report(self):
        return {"odd": eval(self.value)} if self.what == "report" else {}


vocabulary = Vocabulary.of(eCount, Adder)
"""


def odd(folder, what, value):
    """A world with a service that saves or reports a value."""
    members = '[process.adders]\nagents = "oddities:Adder"\n[process.odd]\n' + (
        f'service = "oddities:Odd"\nwhat = "{what}"\nvalue = "{value}"\n'
    )
    path = write_world(folder, members, string="AAdder#a", frames=3)
    path.write_text(path.read_text().replace("yard:vocabulary", "oddities:vocabulary"))
    (folder / "oddities.py").write_text(ODD)
    return path


@pytest.mark.parametrize(
    ("what", "value", "said"),
    [
        ("save", "{1}", "it['odd'] is of type set"),
        ("save", "[1 << 64]", "it['odd'][0] is a whole number of more than 64 bits"),
        ("save", "chr(0xD800)", "it['odd'] is a text with lone surrogates"),
        ("save", "__import__('functools').reduce(lambda v, _: [v], range(200), 1)", "100 deep"),
        ("report", "1 << 64", "its figure 'odd' is a whole number of more than 64 bits"),
        ("report", "[1]", "it reports 'odd' as list; a figure is"),
    ],
)
@pytest.mark.parametrize("place", [["--in-process"], []])
def test_a_value_that_cannot_be_sent_is_an_error_of_the_service(tmp_path, what, value, said, place):
    done = minerva(tmp_path, "run", odd(tmp_path, what, value), *place)
    assert said in done.stderr
    assert f"Odd.{what}" in done.stderr
    assert "msgpack" not in done.stderr
    # Figures are read at the end of the run, when the string is complete.
    assert done.returncode == 1 or what == "report"


def test_a_figure_from_numpy_is_reported(tmp_path):
    path = odd(tmp_path, "report", "__import__('numpy').int64(7)")
    for place in ([], ["--in-process"]):
        assert summary(minerva(tmp_path, "run", path, "--json", *place))["odd"] == 7
