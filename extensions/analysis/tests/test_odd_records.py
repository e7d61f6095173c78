"""Values of wrong types in public functions: an error of ours, which names the argument."""

import pytest

from minerva_analysis import diff, explain, export, graph, replay, replay_swapped, replay_views
from minerva_bus import record
from tests.api.frogs import pond
from tests.odd_arguments import check_refusals

CALLS = {
    "graph": lambda odd, path: graph(odd),
    "diff": lambda odd, path: diff(odd, path),
    "replay": lambda odd, path: replay(odd, pond()),
    "explain agent": lambda odd, path: explain(path, odd, "size", world=pond()),
    "explain value": lambda odd, path: explain(path, "a", odd, world=pond()),
    "explain frame": lambda odd, path: explain(path, "a", "size", odd, pond()),
    "export": lambda odd, path: export(odd),
    "export begin": lambda odd, path: export(path, begin=odd),
    "export end": lambda odd, path: export(path, end=odd),
    "export every": lambda odd, path: export(path, every=odd),
    "export into": lambda odd, path: export(path, into=odd),
    "swapped": lambda odd, path: replay_swapped(path, odd, "each", pond()),
    "views": lambda odd, path: replay_views(path, odd, pond(), quiet=True),
}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """A record."""
    made = tmp_path_factory.mktemp("odd") / "pond.mcap"
    record(pond(), made, frames=2)
    return made


@pytest.mark.parametrize("name", CALLS)
def test_odd_arguments_are_refused_by_an_error_of_ours(name, path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_refusals(lambda odd: CALLS[name](odd, path))
