"""Elementary functions whose results are bitwise identical on all processors."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import minerva_bus.portable as portable
from minerva_bus.portable.polynomials import FEW
from minerva_bus.world.context import Rng, RngBatch, stream

ONE = ["sin", "cos", "tan", "asin", "acos", "atan", "exp", "expm1", "tanh"]
ONE += ["log", "log2", "log10", "log1p"]
TWO = ["atan2", "hypot", "power"]
MATH = {"power": "pow"}
SPECIAL = [0.0, 0.5, 1.0, 2.0, 3.0, 1e-300, 5e-324, 2.2e-308, 1e300, 1.7976931348623157e308]
SPECIAL += [math.inf, math.pi, math.pi / 2, math.pi / 4, math.ulp(1.0), 1 - 2**-53, 709.0, 800.0]
SPECIAL += [-number for number in SPECIAL] + [math.nan]
ULPS = 2.0  # the libraries have an error of up to 1

anything = st.one_of(
    st.floats(), st.floats(-10, 10), st.floats(-2e6, 2e6), st.sampled_from(SPECIAL)
)


def bits(x):
    return float(x).hex(), math.copysign(1.0, x) if x == x else 0


def outcome(function, *numbers):
    try:
        return function(*numbers)
    except (ValueError, OverflowError) as error:
        return type(error)


def assert_close(result, expected, *numbers):
    if isinstance(expected, type) or not math.isfinite(expected) or expected == 0:
        same = result is expected if isinstance(expected, type) else bits(result) == bits(expected)
        assert same, (numbers, result, expected)
    else:
        assert abs(result - expected) <= ULPS * math.ulp(expected), (numbers, result, expected)
        assert math.copysign(1, result) == math.copysign(1, expected)


@pytest.mark.parametrize("name", ONE)
def test_special_numbers_give_what_math_gives(name):
    for x in SPECIAL:
        assert_close(outcome(getattr(portable, name), x), outcome(getattr(math, name), x), x)


@pytest.mark.parametrize("name", TWO)
def test_pairs_of_special_numbers_give_what_math_gives(name):
    other = getattr(math, MATH.get(name, name))
    for x in SPECIAL:
        for y in SPECIAL:
            assert_close(outcome(getattr(portable, name), x, y), outcome(other, x, y), x, y)


@pytest.mark.parametrize("name", ONE)
@given(x=anything)
def test_a_number_gives_what_math_gives_to_two_last_places(name, x):
    expected = outcome(getattr(math, name), x)
    result = outcome(getattr(portable, name), x)
    if expected is OverflowError or result is OverflowError:
        assert result is expected or abs(x) > 709.78
    else:
        assert_close(result, expected, x)


@pytest.mark.parametrize("name", TWO)
@given(x=anything, y=anything)
def test_two_numbers_give_what_math_gives_to_two_last_places(name, x, y):
    expected = outcome(getattr(math, MATH.get(name, name)), x, y)
    result = outcome(getattr(portable, name), x, y)
    if OverflowError not in (expected, result):
        assert_close(result, expected, x, y)


def same_in_an_array(function, *columns):
    # Few numbers are computed one by one, so they are repeated for the form for arrays.
    times = FEW // len(columns[0]) + 1
    with np.errstate(all="raise"):
        few = function(*(np.array(column[:FEW]) for column in columns)).tolist()
        values = function(*(np.array(column * times) for column in columns)).tolist()
    assert [*map(bits, few)] == [*map(bits, values[: len(few)])]
    for numbers, result in zip(zip(*columns, strict=True), values[: len(columns[0])], strict=True):
        expected = outcome(function, *numbers)
        if isinstance(expected, type):
            assert not math.isfinite(result), (numbers, result)
        else:
            assert bits(result) == bits(expected), (numbers, result, expected)


@pytest.mark.parametrize("name", ONE)
@given(numbers=st.lists(anything, min_size=1, max_size=40))
def test_an_array_holds_what_its_numbers_give_to_the_bit(name, numbers):
    same_in_an_array(getattr(portable, name), numbers)


@pytest.mark.parametrize("name", TWO)
@given(pairs=st.lists(st.tuples(anything, anything), min_size=1, max_size=40))
def test_two_arrays_hold_what_their_numbers_give_to_the_bit(name, pairs):
    same_in_an_array(getattr(portable, name), *map(list, zip(*pairs, strict=True)))


@pytest.mark.parametrize("name", ONE)
def test_many_numbers_of_each_size_are_the_same_one_by_one(name):
    random = np.random.default_rng(1)
    near = random.uniform(-1, 1, 6000)
    wide = random.uniform(-800, 800, 3000)
    same_in_an_array(getattr(portable, name), np.concatenate([near, wide, 1 + near]).tolist())


@given(numbers=st.lists(anything, max_size=40))
def test_cosine_and_sine_together_are_those_of_each(numbers):
    for x in numbers:
        result = outcome(portable.cos_sin, x)
        expected = outcome(portable.cos, x), outcome(portable.sin, x)
        if result is ValueError:
            assert expected == (ValueError, ValueError)
        else:
            assert list(map(bits, result)) == list(map(bits, expected))
    angles = np.array(numbers, np.float64)
    for result, single in zip(portable.cos_sin(angles), (portable.cos, portable.sin), strict=True):
        assert list(map(bits, result)) == list(map(bits, single(angles)))


def test_cosines_and_sines_of_many_angles_keep_their_shape():
    angles = np.linspace(-20, 20, 9000).reshape(3, 3000)
    cos, sin = portable.cos_sin(angles)
    assert np.array_equal(cos, portable.cos(angles))
    assert np.array_equal(sin, portable.sin(angles))
    few = angles[:, :4]
    assert np.array_equal(portable.cos_sin(few), (portable.cos(few), portable.sin(few)))


def test_arrays_keep_their_shape_and_are_broadcast():
    grid = np.linspace(0, 1, 6).reshape(2, 3)
    assert portable.sin(grid).shape == (2, 3)
    assert portable.hypot(grid, 1.0).tolist() == [
        [portable.hypot(x, 1.0) for x in row] for row in grid.tolist()
    ]
    assert portable.atan2(1, grid[0]).shape == (3,)
    assert portable.exp(np.array(1)) == portable.exp(1)
    assert portable.cos(np.array([], np.float32)).dtype == np.float64
    assert type(portable.sin(np.float64(1))) is float


@given(x=st.floats(-1e300, 1e300))
def test_symmetries_are_exact(x):
    for odd in (portable.sin, portable.tan, portable.atan, portable.tanh):
        assert bits(odd(-x)) == bits(-odd(x))
    assert portable.cos(-x) == portable.cos(x)


def test_the_angle_that_is_nearest_to_a_multiple_of_half_pi():
    """J.-M. Muller, Elementary Functions (1997), section 9.4: no double is nearer to one."""
    worst = math.ldexp(6381956970095103.0, 797)
    assert math.isclose(portable.cos(worst), -4.68716592425462761112e-19, rel_tol=3e-16)


def test_whole_results_are_exact():
    assert [portable.log2(2.0**k) for k in range(-1074, 1024)] == list(range(-1074, 1024))
    assert [portable.log10(10.0**k) for k in range(23)] == list(range(23))
    assert [portable.power(x, 2) for x in range(-99, 99)] == [x * x for x in range(-99, 99)]
    assert portable.hypot(3, 4) == portable.dist((1, 1), (4, 5)) == 5
    assert portable.exp(0) == portable.cos(0) == 1


def test_the_bits_are_those_of_every_platform():
    """A change here invalidates existing records."""
    assert portable.sin(1e6).hex() == "-0x1.6664b2568d867p-2"
    assert portable.log(0.3).hex() == "-0x1.34378fcbda721p+0"
    assert portable.power(1.7, -3.3).hex() == "0x1.6381ddcf93584p-3"
    drawn = Rng.of(1, 2)
    assert drawn.normal().hex() == "-0x1.aff6bc6a36fa1p+0"
    assert drawn.exponential().hex() == "0x1.063cb6c5085b7p-1"


EXACT = {
    "math": "copysign floor frexp inf isfinite isinf ldexp nan pow sqrt tau",
    "np": "abs any arange array asarray broadcast_arrays clip copysign empty errstate flatnonzero"
    " float64 floor frexp inf int32 int64 isfinite isnan ldexp maximum minimum nan ndarray"
    " ones power random rint searchsorted sqrt uint64 where zeros",
}


@pytest.mark.parametrize("path", sorted(Path(portable.__file__).parent.glob("*.py")), ids=str)
def test_nothing_is_used_that_is_not_exact(path):
    """`pow` and `power` are used for 0, infinity and nan only, where all libraries agree."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            allowed = EXACT.get(node.value.id)
            assert allowed is None or node.attr in allowed.split(), f"{path.name}: {node.attr}"
        powers = isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)
        assert not powers or isinstance(node.left, ast.Constant), f"{path.name}: **"


@given(words=st.lists(st.integers(0, 2**64 - 1), min_size=1, max_size=30))
def test_one_draws_what_many_draw(words):
    batch = RngBatch(np.array(words, np.uint64))
    each = [Rng(word) for word in words]
    for drawn in ("normal", "exponential", "random"):
        expected = [getattr(stream, drawn)() for stream in each]
        assert getattr(batch, drawn)().tolist() == expected
    assert batch.normal(3, 0.1).tolist() == [stream.normal(3, 0.1) for stream in each]


def test_normal_numbers_of_a_generator_are_those_of_its_uniform_ones():
    single, batch, uniform = (stream(1, "a", 2) for _ in range(3))
    first, second = uniform.random(2).tolist()
    radius = math.sqrt(-2 * math.log(1 - first))
    expected = radius * math.cos(math.tau * second)
    assert portable.normal(single) == portable.normals(batch, 1).item()
    assert math.isclose(portable.normal(stream(1, "a", 2), 3.0), 3 * expected)
    assert single.random() == batch.random() == uniform.random()


def test_draws_are_distributed_as_they_should_be():
    batch = RngBatch(RngBatch.begin(np.arange(200_000, dtype=np.uint64), 5))
    for numbers in (batch.normal(), portable.normals(stream(1, "a", 2), 200_000)):
        assert abs(numbers.mean()) < 0.01
        assert abs(numbers.std() - 1) < 0.01
        assert abs((numbers > 1.959964).mean() - 0.025) < 0.002
    waits = batch.exponential(2.0)
    assert abs(waits.mean() - 2) < 0.03
    assert abs((waits > 2 * math.log(10)).mean() - 0.1) < 0.003


ROOT = Path(portable.__file__).parents[2]
OURS = "minerva_bus/grammar minerva_bus/semantics minerva_bus/world minerva_bus/frame"
OURS += " agents/minerva_agents services/minerva_services worlds/minerva_worlds"
PICTURES = "views datasets vision sight.py picture.py"
OUTSIDE = (
    "messages.py sending.py ros_robot.py node.py floor.py nav2.py"  # a real robot's side
    " loop_closure.py mapping.py trajectories.py"  # `minerva map`: no world runs
)
SAME_ON_NONE = {
    "math": "sin cos tan asin acos atan atan2 sinh cosh tanh asinh acosh atanh exp exp2 expm1 log"
    " log1p log2 log10 cbrt pow hypot dist gamma lgamma erf erfc",
    "np": "sin cos tan arcsin arccos arctan arctan2 sinh cosh tanh arcsinh arccosh arctanh exp exp2"
    " expm1 log log1p log2 log10 cbrt power float_power hypot logaddexp dot inner vdot matmul"
    " einsum tensordot linalg fft polyfit cov corrcoef convolve",
}


def of_the_libraries(path):
    """Names of functions in a file whose last bits depend on the processor."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.attr in SAME_ON_NONE.get(node.value.id, "").split():
                yield f"{node.value.id}.{node.attr}, line {node.lineno}"
        elif isinstance(node, ast.ImportFrom) and node.module == "math":
            for name in node.names:
                if name.name in SAME_ON_NONE["math"].split():
                    yield f"math.{name.name}, line {node.lineno}"


def test_code_that_computes_the_string_uses_portable_functions():
    beside = PICTURES.split()
    for folder in OURS.split():
        for path in sorted((ROOT / folder).rglob("*.py")):
            if not set(path.parts) & set(beside) and not path.as_posix().endswith(
                tuple(OUTSIDE.split())
            ):
                assert not list(of_the_libraries(path)), path.relative_to(ROOT)
