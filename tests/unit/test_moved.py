"""Former module names resolve to the modules at their new names."""

import importlib
import sys

import pytest

from minerva_bus.moved import MOVED, new_name


@pytest.mark.parametrize(("old", "new"), MOVED.items())
def test_a_former_name_gives_the_same_module(old, new):
    sys.modules.pop(old, None)
    with pytest.warns(DeprecationWarning, match=rf"{old} is now {new}"):
        module = importlib.import_module(old)
    assert module is importlib.import_module(new)
    assert (module.__name__, module.__spec__.name) == (new, new)


def test_modules_inside_move_too():
    sys.modules.pop("minerva_bus.world.acl.outside", None)
    with pytest.warns(DeprecationWarning, match="is now"):
        from minerva_bus.world.acl.outside import Outside
    from minerva_bus.acl import Outside as Same

    assert Outside is Same


def test_names_that_only_begin_alike_are_not_former_names():
    assert new_name("minerva_bus.recorder") is None


def test_an_unknown_module_at_a_former_name_is_reported_by_its_new_one():
    with pytest.raises(ModuleNotFoundError, match=r"minerva_bus\.log\.nothing"):
        importlib.import_module("minerva_bus.record.nothing")
