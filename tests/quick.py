"""`pytest -m quick`: tests in one process, without waiting, chosen by cost and coverage.

The list contains files, and folders with all of their files, below tests/ or of an extension. Each part of the system that can be
tested without a bus is represented: the paper's equations and tables, laws of the language and of
engines, the wire format, the boundaries where untrusted data enters, settings and errors.
"""

from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings

TESTS = Path(__file__).parent
EXTENSIONS = TESTS.parent / "extensions"
QUICK = (
    "paper",
    "laws/test_language_laws.py",
    "laws/test_collect_laws.py",
    "frame/test_frame_parts.py",
    "scenarios/test_endings.py",
    "scenarios/test_joining.py",
    "scenarios/test_norm_files.py",
    "scenarios/test_orders.py",
    "wire/test_codec.py",
    "fuzz/test_corpus.py",
    "golden/test_golden_messages.py",
    "api/test_collected.py",
    "unit/test_agent_classes.py",
    "unit/test_references.py",
    "unit/test_events.py",
    "unit/test_layers.py",
    "unit/test_types.py",
    "unit/test_naming.py",
    "unit/test_settings.py",
    "unit/test_scenes.py",
    "unit/test_symbols.py",
    "unit/test_toml.py",
    "unit/test_vocabulary.py",
    "unit/test_wording.py",
    "extensions/messages/tests/test_acl_messages.py",
)


def left_out(path):
    """The extension of a path below extensions/ that this copy of the project does not have, or None."""
    top, name, *_ = [*Path(path).parts, "", ""]
    return name if top == EXTENSIONS.name and not (EXTENSIONS / name).is_dir() else None


EXAMPLES = 10
"""Maximum number of examples of a law; the full run uses 30 to 200."""
_SETTINGS = "_hypothesis_internal_use_settings"


def pytest_ignore_collect(collection_path, config):
    """Skip all other test modules in the quick run, because importing them outlasts its tests."""
    if config.getoption("markexpr") == "quick" and collection_path.name.startswith("test_"):
        return None if is_quick(collection_path) else True
    return None


@cache  # 10,000 tests are in 450 files.
def is_quick(path):
    """Whether the list contains a test file or one of its folders."""
    for root in (TESTS, EXTENSIONS.parent):
        if root in path.parents:
            name = path.relative_to(root)
            return str(name) in QUICK or str(name.parent) in QUICK
    return False


def pytest_collection_modifyitems(config, items):
    """Mark the listed tests except on-demand ones; give laws fewer examples."""
    for item in items:
        demanded = item.get_closest_marker("slow") or item.get_closest_marker("deploy")
        if is_quick(item.path) and not demanded:
            item.add_marker(pytest.mark.quick)
            law = getattr(item.obj, _SETTINGS, None)
            if law is not None and config.getoption("markexpr") == "quick":
                fewer = settings(law, max_examples=min(law.max_examples, EXAMPLES))
                setattr(item.obj, _SETTINGS, fewer)
