"""What a search varies, as distributions of Optuna, and the samplers that vary it.

Options and keys of processes have no declared type, so their bounds decide about it. Parameters of
the string have a type: bounds have its range and may have units.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final, TypeAlias, cast

from minerva_bus.collect.data_tables import needed
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.assignment import Parameter, names_nodes, parameter_of
from minerva_bus.launch.toml_tables import option_text
from minerva_study.domains import Interval, OneOf, parse_domain

if TYPE_CHECKING:
    import optuna

    Distributions: TypeAlias = dict[str, optuna.distributions.BaseDistribution]

Ranges: TypeAlias = Mapping[str, "tuple[float, float] | list[Any] | str"]
"""By option, PROCESS.KEY, SYMBOL.NAME or #ID.NAME: bounds (low, high) of a number, a list of
values, or for parameters of the string also a text such as "-90deg:1rad"."""

SAMPLERS: Final = {
    "tpe": "TPESampler",
    "cma-es": "CmaEsSampler",
    "nsga-ii": "NSGAIISampler",
    "random": "RandomSampler",
}
"""Optuna's classes by the names of the command line."""

_SEARCHED: Final = frozenset({"real", "int", "bool", "text"})


def sampler_named(name: str, seed: int) -> optuna.samplers.BaseSampler:
    """A sampler with a seed. Raises MisuseError."""
    optuna = needed("optuna", "optuna")
    if name not in SAMPLERS:
        close = nearest(name, list(SAMPLERS), f"there are {', '.join(SAMPLERS)}")
        raise MisuseError(f"there is no sampler {name!r}{close}")
    if name == "cma-es" and find_spec("cmaes") is None:
        raise MisuseError("the sampler cma-es needs one more library: pip install cmaes")
    return getattr(optuna.samplers, SAMPLERS[name])(seed=seed)


def distributions(ranges: Ranges, scene: Scene, vocabulary: Vocabulary) -> Distributions:
    """Ranges as distributions; keys of nodes name those of `scene`. Raises MisuseError."""
    needed("optuna", "optuna")
    if not ranges:
        raise MisuseError('ranges: there is no option; expected such as {"speed": (0.1, 2.0)}')
    return {
        key: _of_parameter(parameter_of(key, scene, vocabulary), given)
        if names_nodes(key)
        else _of_option(key, given)
        for key, given in ranges.items()
    }


def _of_option(key: str, given: Any) -> optuna.distributions.BaseDistribution:
    import optuna

    if isinstance(given, list) and given:
        return optuna.distributions.CategoricalDistribution(cast("list[Any]", given))
    low, high = _bounds(key, given)
    if isinstance(low, int) and isinstance(high, int):
        return optuna.distributions.IntDistribution(low, high)
    return optuna.distributions.FloatDistribution(low, high)


def _of_parameter(of: Parameter, given: Any) -> optuna.distributions.BaseDistribution:
    import optuna

    kind = of.field.type.kind
    if kind not in _SEARCHED:
        raise MisuseError(f"{of.key}: expected a number, a boolean or a text, not a {kind}")
    domain = _domain(of, given)
    if isinstance(domain, OneOf):
        return optuna.distributions.CategoricalDistribution(cast("Any", domain.values))
    # The ends of a range that were given as numbers of another type have the parameter's.
    low, high = _bounds(of.key, (domain.low, domain.high))
    if kind == "int":
        return optuna.distributions.IntDistribution(int(low), int(high))
    return optuna.distributions.FloatDistribution(low, high)


def _domain(of: Parameter, given: Any) -> Interval | OneOf:
    if isinstance(given, list) and given:
        values = cast("list[Any]", given)
        return OneOf(tuple([of.value(option_text(value)) for value in values]))
    if isinstance(given, str):
        return parse_domain(given, of.field.type, of.key)
    if of.field.type.kind not in ("real", "int"):
        raise MisuseError(f"{of.key}: a {of.field.type.kind} has no bounds; expected values")
    low, high = _bounds(of.key, given)
    return parse_domain(f"{option_text(low)}:{option_text(high)}", of.field.type, of.key)


def _bounds(key: str, given: Any) -> tuple[Any, Any]:
    if isinstance(given, tuple):
        ends = cast("tuple[Any, ...]", given)
        if len(ends) == 2 and ends[0] < ends[1]:
            return ends[0], ends[1]
    raise MisuseError(
        f"ranges: {key} is {given!r:.60}; expected bounds such as (0.1, 2.0), or a list of values"
    )
