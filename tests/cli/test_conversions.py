"""Plain values are converted without pydantic, and to what typer makes of them."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer import BadParameter, Context
from typer.main import get_command

from minerva_bus.cli.command_classes import plain
from minerva_bus.cli.main import app

VALUES = ["", "5", "-3", "05", "0", "7.50", "-0.25", "1e3", "nan", "1_0", " 5", "true", "no"]
VALUES += ["a b", "ü", "/", "/nowhere", "x" * 300, 3, 2.5, True, False, Path("a"), "9" * 30]


def parameters():
    """One parameter of each kind and range that a command has."""
    group = get_command(app)
    context = Context(group)
    kinds = {}
    for name in group.list_commands(context):
        for parameter in group.get_command(context, name).params:
            descriptor = parameter.type_descriptor
            info = descriptor.parameter_info
            kinds.setdefault((str(descriptor.annotation), info.min, info.max), parameter)
    return [
        pytest.param(each, context, id=f"{key}") for key, each in sorted(kinds.items(), key=str)
    ]


@pytest.mark.parametrize(("parameter", "context"), parameters())
def test_a_plain_value_is_converted_as_typer_does(parameter, context):
    descriptor = parameter.type_descriptor
    typer: Any = parameter.get_runtime_param()
    several = descriptor.is_list
    converted = 0
    for value in [[each] for each in VALUES] if several else VALUES:
        try:
            ours = plain(value, descriptor.annotation, descriptor.parameter_info)
        except ValueError:
            continue
        except BadParameter:
            with pytest.raises(BadParameter):
                typer.coerce(value, param=parameter, ctx=context)
            continue
        try:
            theirs = typer.coerce(value, param=parameter, ctx=context)
        except BadParameter as refused:
            pytest.fail(f"typer refuses {value!r}: {refused}")
        assert (type(ours), repr(ours)) == (type(theirs), repr(theirs))
        converted += 1
    assert converted


def test_a_wrong_value_has_the_message_of_typer():
    words = [sys.executable, "-m", "minerva_bus", "pub", "eTick", "--timeout", "-1"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 2
    assert "greater than or equal to 0" in done.stderr


def test_a_command_with_plain_values_does_not_import_pydantic():
    program = "import sys; sys.argv[0] = 'minerva'; from minerva_bus.cli.main import main\n"
    program += "try:\n    main()\nexcept SystemExit:\n    print('pydantic' in sys.modules)"
    words = [sys.executable, "-c", program, "pub", "--timeout", "1.5", "nothing", "--connect", "no"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.stdout.endswith("False\n"), done.stderr
