"""A small world, and typical beginners' mistakes as changes of its text.

A line that ends with `#!` is the faulty line, which the error message must name.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

CODE = '''\
"""Plants that grow in the sun."""

import random
import time

from minerva_bus import (
    EMPTY, Agent, Device, Event, EventType, Generator, Metres, Primitive, Transformation,
    Vocabulary, on, view,
)

PDot = Primitive("PDot", size=float)
TMove = Transformation("TMove", x=float)
eSun = EventType("eSun", light=float)
eWind = EventType("eWind")
ePicture = EventType("ePicture", visual=True)


class Plant(Agent, symbol="APlant"):
    height: Metres = 0.0
    energy: float = 1.0
    births: int = 0

    @on("eSun")
    def grow(self, sun, moment):
        self.height += sun.light

    @view("ePicture")
    def picture(self, event):
        return TMove(x=0.0)(PDot(size=self.height))


class Sun(Generator, events=("eSun",)):
    def __init__(self, strength: float = 1.0) -> None:
        self.strength = strength

    def generate(self, tick):
        yield eSun(light=self.strength)


class Watch(Device, draws=("ePicture",), when="each frame"):
    def show(self, shown):
        self.last = shown.frame


vocabulary = Vocabulary.of(PDot, TMove, eSun, eWind, ePicture, Plant)
'''

FILE = """\
[world]
string = "APlant#a · APlant#b"
vocabulary = "garden:vocabulary"
frames = 5

[process.plants]
agents = "garden:Plant"

[process.sun]
service = "garden:Sun"
strength = 0.5

[process.watch]
service = "garden:Watch"

[bus]
soft = 0.3
hard = 1.0
"""

GROW = "        self.height += sun.light\n"
SHINE = "        yield eSun(light=self.strength)\n"
SHOW = "        self.last = shown.frame\n"
SEE = "        return TMove(x=0.0)(PDot(size=self.height))\n"
MAKE = "        self.strength = strength\n"
AGENTS = 'agents = "garden:Plant"'


@dataclass(frozen=True)
class Mistake:
    """A replacement of text in the code or in the world file.

    `says` are words of the message; `at` is False if no module has the faulty line. `goes_on`: the
    world runs nevertheless.
    """

    name: str
    instead: str
    written: str
    says: tuple[str, ...] = ()
    at: bool = True
    in_file: bool = False
    goes_on: bool = False

    @property
    def code(self) -> str:
        return CODE if self.in_file else self._changed(CODE)

    @property
    def file(self) -> str:
        return self._changed(FILE) if self.in_file else FILE

    def _changed(self, text: str) -> str:
        assert self.instead in text, self.name
        return text.replace(self.instead, self.written, 1)

    @property
    def line(self) -> int:
        """Number of the faulty line."""
        return next(
            number
            for number, line in enumerate(self.code.split("\n"), 1)
            if line.rstrip().endswith("#!")
        )

    def write(self, folder: Path) -> Path:
        """Write the world file and its module; returns the path of the world file."""
        (folder / "garden.py").write_text(self.code, encoding="utf-8")
        path = folder / "garden.toml"
        path.write_text(self.file, encoding="utf-8")
        return path


def _says(*words: str) -> tuple[str, ...]:
    return words


MISTAKES = (
    # --- λ ---
    Mistake("misspelt attribute", GROW, "        self.height += self.enrgy  #!\n",
            _says("Plant.grow", "#a", "eSun", "frame 0", "has no attribute 'enrgy'", "energy")),
    Mistake("new attribute", GROW, "        self.heigth = 1.0  #!\n", _says("heigth", "height"), at=False),
    Mistake("exception in an activity", GROW, "        self.height = 1 / 0  #!\n", _says("ZeroDivisionError", "division by zero")),
    Mistake("exception in a helper", GROW,
            "        helper({})\n\n\ndef helper(table):\n    return table['size']  #!\n\n\nclass Unused:\n    def f(self):\n        pass\n",
            _says("KeyError", "'size'", "helper")) ,
    Mistake("exception in a library", GROW, "        random.choice([])  #!\n", _says("IndexError")),
    Mistake("chained exceptions", GROW,
            "        try:\n            {}['size']  #!\n        except KeyError as error:\n            raise ValueError('no size') from error\n",
            _says("ValueError: no size", "KeyError: 'size'")),
    Mistake("exception without a text", GROW, "        assert False  #!\n", _says("AssertionError")),
    Mistake("exception with a long text", GROW, "        raise ValueError('x\\n' * 500)  #!\n", _says("ValueError")),
    Mistake("own exception", GROW,
            "        class Dry(Exception):\n            pass\n        raise Dry('no water')  #!\n", _says("Dry: no water")),
    Mistake("raises what is no exception", GROW, "        raise 'dry'  #!\n", _says("TypeError", "exceptions must derive")),
    Mistake("exception whose text fails", GROW,
            "        class Broken(Exception):\n            def __str__(self):\n                return self.text\n\n"
            "        raise Broken  #!\n", _says("Broken", "__str__ raises AttributeError")),
    Mistake("exception that is no Exception", GROW, "        import asyncio\n        raise asyncio.CancelledError  #!\n", _says("CancelledError")),
    Mistake("group of exceptions with control characters", GROW,
            "        raise ExceptionGroup('dry\\a', [ValueError('no \\x1b[3mwater')])  #!\n",
            _says("ExceptionGroup: dry\\x07", "caused by ValueError: no \\x1b[3mwater")),
    Mistake("exits", GROW, "        raise SystemExit(3)  #!\n", _says("SystemExit")),
    Mistake("calls sys.exit", GROW, "        import sys\n        sys.exit()  #!\n", _says("SystemExit")),
    Mistake("keyboard interrupt", GROW, "        raise KeyboardInterrupt  #!\n", _says("code of the world: KeyboardInterrupt")),
    Mistake("recursion without end", GROW,
            "        self.grow(sun, moment)  #!\n", _says("RecursionError")),
    Mistake("not a number", GROW, "        self.height = float('nan')  #!\n", _says("height", "nan", "Plant.grow"), at=False),
    Mistake("infinite", GROW, "        self.height = float('inf')  #!\n", _says("height", "inf", "Plant.grow"), at=False),
    Mistake("not a number in an event", GROW, "        moment.emit(eSun(light=float('nan')))  #!\n", _says("light", "nan", "Plant.grow")),
    Mistake("text for a number", GROW, "        self.height = 'tall'  #!\n", _says("height", "'tall'", "Plant.grow"), at=False),
    Mistake("a list for a number", GROW, "        self.height = [1.0]  #!\n", _says("height", "a list", "Plant.grow"), at=False),
    Mistake("deleted attribute", GROW, "        del self.height  #!\n", _says("height", "deleted", "Plant.grow"), at=False),
    Mistake("another id", GROW, "        self.id = 'z'  #!\n", _says("keeps its id", "Plant.grow"), at=False),
    Mistake("returns a number", GROW, "        return 3  #!\n", _says("Plant.grow", "3"), at=False),
    Mistake("returns itself", GROW, "        return self  #!\n", _says("Plant.grow", "self.string"), at=False),
    Mistake("returns itself twice", GROW, "        return self.string + self.string  #!\n", _says("#a", "Plant.grow"), at=False),
    Mistake("emits nothing", GROW, "        moment.emit(None)  #!\n", _says("Plant.grow", "emit")),
    Mistake("emits a type", GROW, "        moment.emit(eSun)  #!\n", _says("Plant.grow", "emit")),
    Mistake("compares the frame with a number", GROW, "        self.height += moment.frame == 3  #!\n", _says("not a number", "write number == 3")),
    Mistake("misspelt datum of an event", GROW, "        self.height += sun.lihgt  #!\n", _says("lihgt", "light")),
    Mistake("changes an event", GROW, "        sun.light = 2.0  #!\n", _says("light of eSun cannot be changed", "make a new one, eSun(...)")),
    Mistake("an event for an agent instead of its id", GROW, "        moment.emit(eWind(receivers=self))  #!\n", _says("receivers must be a list of ids", "not APlant#a")),
    Mistake("an event that the vocabulary lacks", GROW, "        moment.emit(EventType('eHail')())  #!\n",
            _says("Plant.grow: #a", "no event type eHail; add it to the vocabulary"), at=False),
    Mistake("an agent that the vocabulary lacks", GROW,
            "        class Ivy(Agent, symbol='AIvy'): pass\n        return self.string + Ivy('i').string  #!\n",
            _says("Plant.grow: #a", "no AIvy; add its class or symbol to Vocabulary.of(...)"), at=False),
    Mistake("dies as a population does", GROW, "        self.die()  #!\n", _says("has no attribute 'die'; one agent dies by return EMPTY")),
    Mistake("an array in a condition", GROW, "        import numpy\n        if numpy.ones(2):  #!\n            pass\n",
            _says("The truth value of an array", "np.where(mask, a, b), or drop population=True")),
    Mistake("own constructor", GROW, GROW + "\n    def __init__(self, height):  #!\n        self.height = height\n",
            _says("Plant.__init__ would not be called", "declare attributes instead")),
    Mistake("attribute without its type", GROW,
            "        self.energy += 1.0\n        self.age += 1  #!\n\n    age = 0\n",
            _says("APlant#a has no age", "declare it with its type, as in `age: float = 0.0`"), at=False),
    Mistake("child of unknown state", GROW, "        return self.string + self.child(heigth=1.0)  #!\n", _says("heigth", "height")),
    Mistake("a newborn that is not returned", GROW, "        self.string + self.child(height=1.0)  #!\n",
            _says("Plant.grow", "#a", "newborn would be lost", "return self.string + self.child(...)"), at=False),
    # --- θ ---
    Mistake("exception in a view", SEE, "        return PDot(size=self.size)  #!\n", _says("Plant.picture", "#a", "ePicture", "size")),
    Mistake("a view returns nothing", SEE, "        PDot(size=self.height)  #!\n", _says("Plant.picture", "None"), at=False),
    Mistake("a view returns an agent", SEE, "        return self.string  #!\n", _says("Plant.picture", "agent"), at=False),
    Mistake("a view returns a text", SEE, "        return 'PDot(size=1)'  #!\n", _says("Plant.picture", "'PDot(size=1)'"), at=False),
    Mistake("a transformation without its scope", SEE, "        return TMove(x=1.0)\n", _says("Plant.picture", "TMove without its scope"), at=False),
    Mistake("a primitive that is not called", SEE, "        return PDot\n", _says("Plant.picture", "<primitive PDot>"), at=False),
    Mistake("a parameter of a wrong type", SEE, "        return PDot(size='big')  #!\n", _says("PDot", "size", "'big'")),
    Mistake("a parameter is missing", SEE, "        return PDot()  #!\n", _says("PDot", "size")),
    Mistake("a parameter too many", SEE, "        return PDot(size=1.0, colour=3)  #!\n", _says("PDot", "colour")),
    # --- generators ---
    Mistake("an event type for its name", 'class Sun(Generator, events=("eSun",)):', "class Sun(Generator, events=(eSun,)):  #!",
            _says('Sun: events are names, write events=("eSun",)')),
    Mistake("an event type instead of names", 'class Watch(Device, draws=("ePicture",), when="each frame"):', "class Watch(Device, draws=ePicture):  #!",
            _says('Watch: draws are names, write draws=("ePicture",)')),
    Mistake("a device draws what is not visual", 'draws=("ePicture",)', 'draws=("eSun",)',
            _says("process.watch", "draws eSun, which is not visual; expected one of ePicture"), at=False),
    Mistake("exception in a generator", SHINE, "        yield eSun(light=self.power)  #!\n", _says("sun", "Sun.generate", "frame 0", "power")),
    Mistake("exception with invalid Unicode", SHINE, "        raise ValueError('no file \\udcff')  #!\n        yield\n", _says("Sun.generate", "no file \\udcff")),
    Mistake("a generator yields a text", SHINE, "        yield 'eSun'  #!\n", _says("Sun.generate", "'eSun'"), at=False),
    Mistake("a generator yields a type", SHINE, "        yield eSun  #!\n", _says("Sun.generate", "eSun"), at=False),
    Mistake("a generator returns a number", SHINE, "        return 3  #!\n", _says("Sun.generate", "3"), at=False),
    Mistake("a generator returns a text", SHINE, "        return 'eSun'  #!\n", _says("Sun.generate", "not 'eSun'"), at=False),
    Mistake("a generator returns a mapping", SHINE, "        return {'eSun': 1}  #!\n", _says("Sun.generate", "not {'eSun': 1}"), at=False),
    Mistake("an event that is not declared", SHINE, "        yield eWind()  #!\n", _says("Sun", "eWind", "events"), at=False),
    Mistake("a datum is missing", SHINE, "        yield eSun()  #!\n", _says("eSun", "light")),
    Mistake("the frame as a number", SHINE, "        if tick.frame == 3:  #!\n            yield eSun(light=1.0)\n", _says("Sun.generate", "write number == 3")),
    Mistake("data in place", SHINE, "        yield eSun(1.0, 2.0)  #!\n", _says("eSun")),
    Mistake("a generator saves what is no plain value", SHINE,
            SHINE + "\n    def save(self):\n        return {'at': self}\n", _says("Sun.save"), at=False),
    # --- devices ---
    Mistake("exception in a device", SHOW, "        self.last = shown.number  #!\n", _says("watch", "Watch.show", "number")),
    # --- constructors ---
    Mistake("exception in a thread", SHINE,
            SHINE + "\n    def joined(self, world):\n        import threading\n        thread = threading.Thread(target=lambda: 1 / 0)  #!\n"
            "        thread.start()\n        thread.join()\n",  # since the fork does not wait for threads
            _says("thread", "has ended: ZeroDivisionError: division by zero"), goes_on=True),
    Mistake("exception in close", SHINE, SHINE + "\n    def close(self):\n        self.file.close()  #!\n", _says("Sun.close", "file", "5 frames"), goes_on=True),
    Mistake("missing file in joined", SHINE,
            SHINE + "\n    def joined(self, world):\n        self.file = open('sun.csv')  #!\n\n    def close(self):\n        self.file.close()\n",
            _says("Sun.joined", "sun.csv")),
    Mistake("exception in a constructor", MAKE, "        self.strength = {}['strength']  #!\n", _says("[process.sun]", "KeyError")),
    Mistake("missing file in a constructor", MAKE,
            "        self.table = open('sun.csv').read()  #!\n", _says("[process.sun]", "sun.csv")),
    Mistake("wrong value in a constructor", MAKE, "        raise ValueError('strength must be 1')  #!\n", _says("[process.sun]", "strength must be 1")),
    Mistake("constructor that exits", MAKE, "        raise SystemExit('enough')  #!\n", _says("[process.sun]", "enough")),
    Mistake("default that cannot be shared", "    energy: float = 1.0\n", "    energy: list = []  #!\n", _says("energy"), at=False),
    # --- signatures ---
    Mistake("activity without a moment", "    def grow(self, sun, moment):\n", "    def grow(self, sun):  #!\n", _says("Plant.grow", "(self, event, moment)")),
    Mistake("activity without self", "    def grow(self, sun, moment):\n", "    def grow(sun, moment):  #!\n", _says("Plant.grow", "(self, event, moment)")),
    Mistake("asynchronous activity", "    def grow(self, sun, moment):\n", "    async def grow(self, sun, moment):  #!\n", _says("Plant.grow", "async")),
    Mistake("activity with a yield", GROW, GROW + "        yield\n", _says("Plant.grow", "yield"), at=False),
    Mistake("static activity", "    def grow(self, sun, moment):\n", "    @staticmethod\n    def grow(sun, moment):  #!\n", _says("Plant.grow", "(self, event, moment)")),
    Mistake("activity of a class", "    def grow(self, sun, moment):\n", "    @classmethod\n    def grow(cls, sun, moment):  #!\n", _says("Plant.grow", "(self, event, moment)")),
    Mistake("view with a yield", SEE, "        yield PDot(size=1.0)\n", _says("Plant.picture", "yield"), at=False),
    Mistake("show with a yield", SHOW, SHOW + "        yield\n", _says("Watch.show", "yield"), at=False),
    Mistake("asynchronous generate", "    def generate(self, tick):\n", "    async def generate(self, tick):  #!\n", _says("Sun.generate", "async")),
    Mistake("when in other words", 'class Watch(Device, draws=("ePicture",), when="each frame"):',
            'class Watch(Device, draws=("ePicture",), when="often"):  #!', _says('Watch: when = "often"', '"each N frames"')),
    Mistake("when without a unit", 'class Watch(Device, draws=("ePicture",), when="each frame"):',
            'class Watch(Device, draws=("ePicture",), when=25.0):  #!', _says("Watch: when must be a text", "25.0")),
    Mistake("a rate below zero", ', when="each frame"):\n', '):\n    when = "at -1 Hz"\n\n',
            _says("[process.watch]", 'Watch: when = "at -1 Hz"'), at=False),
    Mistake("when of a generator for a device", 'when="each frame"', 'when="on orders"',
            _says("[process.watch]", 'when = "on orders" is for generators, and it is a device'), at=False),
    Mistake("activity for a visual event", '    @on("eSun")\n', '    @on("ePicture")\n', _says("APlant", "ePicture", "use @view"), at=False),
    Mistake("view with a moment", "    def picture(self, event):\n", "    def picture(self, event, moment):  #!\n", _says("Plant.picture", "(self, event)")),
    Mistake("generate without a tick", "    def generate(self, tick):\n", "    def generate(self):  #!\n", _says("Sun.generate", "(self, tick)")),
    Mistake("show without a view", "    def show(self, shown):\n", "    def show(self):  #!\n", _says("Watch.show", "(self, view)")),
    Mistake("marked without a name", '    @on("eSun")\n', "    @on  #!\n", _says("@on")),
    Mistake("marked with an empty name", '    @on("eSun")\n', '    @on("")  #!\n', _says("@on", "event types")),
    Mistake("static method above the mark", '    @on("eSun")\n    def grow(self, sun, moment):\n',
            '    @staticmethod\n    @on("eSun")\n    def grow(self, sun, moment):  #!\n', _says("Plant.grow", "first line above")),
    Mistake("property above the mark", '    @view("ePicture")\n    def picture(self, event):\n',
            '    @property\n    @view("ePicture")\n    def picture(self, event):  #!\n', _says("Plant.picture", "write @view")),
    Mistake("decorator that hides the mark", '    @on("eSun")\n    def grow(self, sun, moment):\n',
            '    @(lambda function: lambda *args: function(*args))\n    @on("eSun")\n    def grow(self, sun, moment):  #!\n',
            _says("Plant.grow would never be called", "write @on")),
    Mistake("mark of a class", '    @on("eSun")\n', '    @on("eWind")  #!\n    class Blow: pass\n\n    @on("eSun")\n', _says("@on marks a method")),
    Mistake("mark of an object", '    @on("eSun")\n', '    blow = on("eWind")(random.Random())  #!\n\n    @on("eSun")\n', _says("@on marks a method", "Random")),
    Mistake("mark of a built-in function", '    @on("eSun")\n', '    blow = on("eWind")(print)  #!\n\n    @on("eSun")\n', _says("@on marks a method", "print")),
    Mistake("annotation that is no expression", "    energy: float = 1.0\n", "    energy: 'float[' = 1.0\n", _says("annotations of Plant", "float["), at=False),
    Mistake("symbol that is no text", 'symbol="APlant"', "symbol=5", _says("A followed by letters"), at=False),
    *[
        Mistake(f"receiver {given}", SHINE, f"        yield eSun(1.0, receivers=[{given}])  #!\n", _says("receivers: ", "not a valid agent id"))
        for given in ("''", "' '", "'a b'", "'#a'", "'a/b'", "'*'", "'..'", "'\xfc'", "'a\\n'", "'b', ''", "'.' * 300")
    ],
    Mistake("receiver of an activity", GROW, "        moment.emit(eWind(receivers=['']))  #!\n", _says("Plant.grow", "receivers: ''")),
    Mistake("receiver of a changed event", SHINE, "        from dataclasses import replace\n        yield replace(eSun(1.0), receivers=('',))\n",
            _says("Sun.generate", "receivers of eSun: ''"), at=False),
    # --- the module ---
    Mistake("byte that is no text", "import random\n", "import random\n\0", _says("null bytes", "garden.py", "UTF-8"), at=False),
    Mistake("unknown encoding", '"""Plants', '# coding: leaves\n"""Plants', _says("unknown encoding: leaves", "garden.py\n"), at=False),
    Mistake("syntax error", GROW, "        self.height += sun.light)  #!\n", _says("unmatched ')'", "^")),
    Mistake("wrong indentation", GROW, "      self.height += sun.light\n       pass  #!\n", _says("indent")),
    Mistake("missing module", "import random\n", "import rnadom  #!\nimport random\n", _says("rnadom", "not installed")),
    Mistake("missing name", "    EMPTY,", "    EMPTTY,", _says("EMPTTY"), at=False),
    Mistake("exception on import", "import random\n", "import random\n\nSIZE = 1 / 0  #!\n", _says("ZeroDivisionError")),
    Mistake("unknown type of attribute", "    energy: float = 1.0\n", "    energy: flaot = 1.0  #!\n", _says("flaot")),
    Mistake("wrong default", "    energy: float = 1.0\n", "    energy: float = 'full'  #!\n", _says("energy", "'full'"), at=False),
    Mistake("agent is not in the vocabulary", "ePicture, Plant)", "ePicture)", _says("APlant", "Plant", "garden", "Vocabulary.of"), at=False),
    Mistake("event is not in the vocabulary", "eSun, eWind,", "eWind,", _says("eSun"), at=False),
    Mistake("wrong event in @on", '    @on("eSun")\n', '    @on("eSnu")  #!\n', _says("eSnu", "eSun"), at=False),
    Mistake("wrong event in a generator", 'events=("eSun",)', 'events=("eSnu",)', _says("eSnu", "eSun"), at=False),
    # --- the world file ---
    Mistake("string as a scene", 'string = "APlant#a · APlant#b"', 'scene = "APlant#a · APlant#b"',
            _says("garden.toml:2", "world.scene must name a function", 'write string = "..."'), at=False, in_file=True),
    Mistake("scene of no module", 'string = "APlant#a · APlant#b"', 'scene = "grden:scene"',
            _says("garden.toml:2", "world.scene", "no module grden"), at=False, in_file=True),
    Mistake("path of a module", AGENTS, 'agents = "./garden:Plant"', _says("garden.toml:7", "such as 'garden:Plant'"), at=False, in_file=True),
    Mistake("file of a module", AGENTS, 'agents = "garden.py:Plant"', _says("garden.toml:7", "such as 'garden:Plant'"), at=False, in_file=True),
    Mistake("an event type twice in the order", "frames = 5", 'frames = 5\norder = ["eSun", "eWind", "eSun"]',
            _says("garden.toml:5", "world.order has eSun twice"), at=False, in_file=True),
    Mistake("misspelt key", "frames = 5", "fraems = 5", _says("fraems", "frames", "garden.toml:4"), at=False, in_file=True),
    Mistake("unit that is none", "APlant#a ", "APlant#a<height=3 ft> ", _says("ft"), at=False, in_file=True),
    Mistake("wrong unit", "APlant#a ", "APlant#a<height=3 s> ", _says("height", "s"), at=False, in_file=True),
    Mistake("unknown parameter", "APlant#a ", "APlant#a<heigth=3 m> ", _says("heigth", "height"), at=False, in_file=True),
    Mistake("duplicate id", "APlant#b", "APlant#a", _says("#a"), at=False, in_file=True),
    Mistake("unknown symbol", "APlant#b", "APlnat#b", _says("APlnat", "APlant"), at=False, in_file=True),
    Mistake("missing process of agents", AGENTS, 'service = "garden:Sun"', _says("APlant", "no host"), at=False, in_file=True, goes_on=True),
    Mistake("unknown option", "strength = 0.5", "strenght = 0.5", _says("strenght", "strength", "garden.toml:11: [process.sun]"), at=False, in_file=True),
    Mistake("option of a wrong type", "strength = 0.5", 'strength = "much"', _says("strength", "much", "garden.toml:11: [process.sun]"), at=False, in_file=True),
    Mistake("no such class", "garden:Watch", "garden:Wacth", _says("Wacth", "Watch"), at=False, in_file=True),
    Mistake("agent as a service", "garden:Watch", "garden:Plant", _says("garden:Plant"), at=False, in_file=True),
    Mistake("text of a condition in single quotes", "[bus]", "[norm.tall]\napplies = \"APlant\"\nwhen = \"height == 'tall'\"\n\n[bus]",
            _says("norm.tall.when", "a text in double quotes"), at=False, in_file=True),
    *[
        Mistake(f"norm of the name {name}", "[bus]", f'[norm."{name}"]\non = "eSun"\n[bus]', _says("cannot name a norm"), at=False, in_file=True)
        for name in ("", " ", "a b", "\xfc", "n" * 300, "..", "a/b", "*", "~x", "a\\nb")
    ],
    *[
        Mistake(f"norm for the person {name}", "[bus]", f'[norm.tall]\non = "eSun"\napplies = "people:{name}"\n[bus]',
                _says("norm.tall.applies names no person", "people:NAME"), at=False, in_file=True)
        for name in ("", " ", "a b", "\xfc", "n" * 300, "a//b", "/", "*", "a\\nb")
    ],
    *[
        Mistake(f"option of the name {name}", "[bus]", f'[options]\n"{name}" = 1\n[bus]', _says("cannot name an option"), at=False, in_file=True)
        for name in ("", " ", "a b", "a-b", "1a", "*", "..", "a\\nb")
    ],
    *[
        Mistake(f"topic {name}", "    def generate(self, tick):\n", f"    {which} = ({name!r},)\n\n    def generate(self, tick):\n",
                _says("[process.sun]", "cannot name a topic"), at=False)
        for name in ("", "a/b", "*", "t" * 300, "\xfc", "$t") for which in ("topics", "publishes")
    ],
    Mistake("control characters", "frames = 5", "frames = 5 \x1b[31m\x07\u202e", _says("garden.toml:4", "frames = 5 ?[31m??"), at=False, in_file=True),
    Mistake("lines that end with CR", "[world]\n", "[world]\r", _says("garden.toml:1", "[world]?string"), at=False, in_file=True),
    Mistake("no TOML", "[process.sun]", "[process.sun", _says("garden.toml"), at=False, in_file=True),
)  # fmt: skip

HARMLESS = (
    Mistake("generate returns one event", SHINE, "        return eSun(light=self.strength)\n"),
    Mistake("generate returns a list", SHINE, "        return [eSun(light=self.strength)]\n"),
    Mistake("generate returns nothing", SHINE, "        return None\n"),
    Mistake("generate yields nothing", SHINE, "        yield None\n"),
    Mistake("print in an activity", GROW, GROW + "        print('growing')\n"),
    Mistake("a newborn that is kept", GROW, "        self._egg = self.child(height=1.0)\n"),
    Mistake("a view that shows nothing", SEE, "        return EMPTY\n"),
    Mistake("save returns a number", SHINE, SHINE + "\n    def save(self):\n        return 7\n"),
)
"""Changes that are allowed here, although other systems reject them."""
