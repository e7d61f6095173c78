"""Cases of strings, columns, ids, patches, events and conditions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from minerva_bus import Primitive, Scene, Vocabulary
from minerva_bus.errors import SceneError
from minerva_bus.grammar.columns import Columns, difference, merged, packed, unfolded
from minerva_bus.grammar.condition import holds
from minerva_bus.grammar.events import single
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.text_and_digest import text
from minerva_bus.wire.columns_codec import plain_columns, plain_ids, plain_patch
from minerva_bus.wire.strings_codec import plain_event, plain_scene
from tools import golden_messages as golden
from tools.vectors.notation import Cases, Json, packed_hex, tagged

VOCABULARY: Final = Vocabulary.of(*golden.ENTRIES, Primitive("PTally", n=int))


def fishes(count: int) -> str:
    """A population as text."""
    return " · ".join(f"AFish#f{n}<x={n}>" for n in range(count))


STRINGS: Final = {
    "empty": "ε", "figure": "PStar<size=0.5>", "agent": 'AFox#a<x=2, name="é">()',
    "no attributes": "AStone#s()",
    "nested": 'PStar<size=0.5> · TMove<dist=1.5>(AFox#a<x=2, name="é">(PStar<size=1>) · '
    "PStar<size=1>)",
    "deep": "TMove<dist=1>(" * 40 + "PStar<size=1>" + ")" * 40,
    "agent in an agent": 'AFox#a<x=0, name="">(AFish#b<x=-0.0>(AStone#c()))',
    "denormal and exponents": "PStar<size=5e-324> · PStar<size=1e+16> · PStar<size=1e-05>",
    "string as a value": "PBox<inside={PStar<size=1> · PStar<size=2>}>",
    "31 neighbours are single nodes": fishes(31), "32 neighbours are a run": fishes(32),
    "two runs": f"{fishes(32)} · {' · '.join(['PStar<size=1>'] * 40)}",
    "a run between nodes": f"PBox<inside={{ε}}> · {fishes(33)} · AStone#s()",
    "a run of nested figures": " · ".join(
        f"TMove<dist={n}>(PStar<size=0.25>)" for n in range(32)
    ),
    "a run of minus zeros": " · ".join(["PStar<size=-0.0>"] * 32),
    "a run of texts": " · ".join(f'AFox#g{n}<x=0, name="é{n}">' for n in range(32)),
}  # fmt: skip


EXACT: Final = 1 << 53
INTS: Final = {
    **{f"ints of {size} bytes": (-(1 << bits), (1 << bits) - 1)
       for size, bits in ((1, 7), (2, 15), (4, 31), (8, 63))},
    **{f"ints above {size} bytes": (0, 1 << bits) for size, bits in ((1, 7), (2, 15), (4, 31))},
    **{f"ints below {size} bytes": (0, -(1 << bits) - 1)
       for size, bits in ((1, 7), (2, 15), (4, 31))},
    "ints that floats can represent": (-EXACT, EXACT),
    "ints below -2^53": (-EXACT - 1, 0), "ints above 2^53": (0, EXACT + 1),
}  # fmt: skip


def tallies(numbers: tuple[int, ...]) -> Columns:
    """A figure with each of these numbers, in columns."""
    return merged(VOCABULARY.read(" · ".join(f"PTally<n={n}>" for n in numbers)).pieces)


def strings() -> Cases:
    """The encoding without columns and the digest of a string, given as text."""
    for name, written in STRINGS.items():
        scene = unfolded(VOCABULARY.read(written))
        expected = {"msgpack": packed_hex(plain_scene(scene)), "digest": scene.digest.hex()}
        yield name, text(scene) or "ε", expected


def _of_rows(count: int) -> Scene:
    return packed(VOCABULARY.read(fishes(count)))


def digests() -> Cases:
    """The digests of long runs, of which only the columns are given."""
    for count in (32, 4096, 4097):
        scene = _of_rows(count)
        yield f"{count} rows", packed_hex(plain_scene(scene)), scene.digest.hex()
    ends = Scene((merged(_of_rows(32).pieces), *VOCABULARY.read("AStone#s()").pieces))
    yield "a run and a node", packed_hex(plain_scene(ends)), ends.digest.hex()
    for name, numbers in INTS.items():
        run = Scene((tallies(16 * numbers),))  # 32 neighbours are a run.
        yield name, packed_hex(plain_scene(run)), run.digest.hex()


COLUMNS: Final[Mapping[str, Columns]] = {
    "agents with consecutive ids": golden.fishes(0, 3),
    "one row": golden.fishes(7, 1),
    "figures in transformations": golden.stars(3),
    "ids without a common stem": merged(
        VOCABULARY.read("AFish#a<x=1> · AFish#b:1<x=-0.0> · AFish#c<x=5e-324>").pieces
    ),
    "texts": merged(VOCABULARY.read('AFox#a<x=1, name="é"> · AFox#b<x=1, name="">').pieces),
    "texts that are ids": merged(
        VOCABULARY.read('AFox#f1<x=1, name="f1"> · AFox#f2<x=1, name="f3">').pieces
    ),
    **{name: tallies(numbers) for name, numbers in INTS.items()},
}


def columns() -> Cases:
    """Columns, and the same nodes one by one."""
    for name, group in COLUMNS.items():
        scene = Scene((group,))
        single_nodes = unfolded(scene)
        expected = {"msgpack": packed_hex(plain_scene(single_nodes)), "text": text(single_nodes)}
        yield name, packed_hex(plain_columns(group)), expected


IDS: Final = {
    "consecutive": Ids("f", np.arange(3)), "numbered": Ids("f", np.array([3, 1, 2])),
    "from another number": Ids("agent-", np.arange(70_000, 70_003)),
    "spelled": Ids.of(["a", "b:1", "c-2"]), "one": Ids.of(["a"]), "long": Ids.of(["x" * 64, "y"]),
}  # fmt: skip


def ids() -> Cases:
    """The forms of ids."""
    for name, group in IDS.items():
        yield name, packed_hex(plain_ids(group)), group.texts()


PATCHES: Final = {
    "one value": (fishes(6), fishes(6).replace("x=2>", "x=-0.0>")),
    "all values": (fishes(2), "AFish#f0<x=7> · AFish#f1<x=8>"),
    "a death": (fishes(8), fishes(8).replace("AFish#f3<x=3> · ", "")),
    "the last one dies": (fishes(8), fishes(7)),
    "a birth": (fishes(8), f"{fishes(8)} · AFish#f7:1<x=0.5>"),
    "birth, death and change": (
        fishes(8),
        fishes(8).replace("AFish#f0<x=0>", "AFish#f1:1<x=9>").replace("x=5>", "x=6>"),
    ),
    "two columns": (
        'AFox#a<x=1, name="p"> · AFox#b<x=2, name="q">',
        'AFox#a<x=3, name="p"> · AFox#b<x=2, name="r">',
    ),
}


def _merged(written: str) -> Columns:
    return merged(VOCABULARY.read(written).pieces)


def patches() -> Cases:
    """Columns and a patch, and the nodes after it."""
    for name, (before, after) in PATCHES.items():
        old, new = _merged(before), _merged(after)
        delta = difference(old, new)
        assert delta is not None, name
        given = {
            "columns": packed_hex(plain_columns(old)),
            "patch": packed_hex(plain_patch(delta)),
        }
        changed = unfolded(Scene((new,)))
        expected = {"msgpack": packed_hex(plain_scene(changed)), "text": text(changed)}
        yield name, given, expected


def events() -> Cases:
    """Events and batches, and the single events that they stand for."""
    for event in (*golden.EVENTS, golden.MIXED, golden.batch(3)):
        plain = [plain_event(each) for each in single([event])]
        shown = {"text": [str(each) for each in single([event])], "msgpack": packed_hex(plain)}
        yield f"{event.type} of {len(plain)}", packed_hex(plain_event(event)), shown


CONDITIONS: Final = (
    *("", "x < 5", "x <= 4.5", "x > 4.5", "x == 4.5", "x != 4.5", 'name == "é"', "alive"),
    *("alive == true", "not (x < 5)", "x < 5 and alive == false", "x < 5 or alive == false"),
    *('not alive == false and (name == "é" or x > 9)', "count == 3", "count < x", "missing < 5"),
    *("distance(x, count, 1.5, -1) == 5", "5 > distance(1.5, -1, x, count)", "distance == x"),
    *("not distance(x, name, 0, 0) < 9", "distance(x, alive, 0, 0) < 9", "distance(x, 0) < 9"),
    *('distance(x, "a", 0, 0) < 9', "distance(x, 0, 0, 0, 0) < 9", "distance(x, 0, 0, 0 < 9"),
    *("not missing < 5", 'name < "f"', "x ==", "(x < 5", "x < 5 and", "x = 5", "name < 5"),
)
STATE: Final = {"x": 4.5, "count": 3, "name": "é", "alive": True}


def conditions() -> Cases:
    """Whether a condition holds for a state; `refused` for one that is no condition."""
    for condition in CONDITIONS:
        try:
            expected: Json = holds(condition, STATE)
        except SceneError:
            expected = "refused"
        given = {"condition": condition, "state": tagged(STATE)}
        yield condition or "empty", given, expected
