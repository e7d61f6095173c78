"""Models of the NetLogo library as worlds: their parameters, and their statistics beside Mesa's.

The registries of packages have no NetLogo. Wolf Sheep Predation and Flocking are compared with the
versions that Mesa publishes. Mesa lacks the others: `in_mesa` has programs for it, written from the
same descriptions, so these judge the platform, and not how a description is understood.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from minerva_bus import run
from tools.acceptance.suite import MissingSuiteError, Outcome, Result, Suite, judged

SEEDS = 40
ERROR = 0.01
"""The probability that a model is judged to be different although it is the same."""

STEPS = {"ants": 300, "flocking": 60, "heatbugs": 100, "wolf_sheep": 10, "aids": 150}

Figures = Mapping[str, float]
Parameters = Mapping[str, float]


def _results(folder: Path) -> Iterator[Result]:
    missing = [name for name in ("mesa", "numba") if find_spec(name) is None]
    if missing:
        raise MissingSuiteError(f"pip install {' '.join(missing)}")
    for path, name, parameters in (
        ("Ants", "ants", _of_ants),
        ("Heatbugs", "heatbugs", _of_heatbugs),
        ("HIV", "aids", _of_aids),
    ):
        yield _judged_parameters(folder / f"{path}.nlogox", name, parameters)
    for name in STEPS:
        yield from _judged_statistics(name)


def _judged_parameters(path: Path, name: str, of: Callable[[Any], Parameters]) -> Result:
    """Whether a world has the size and the parameters of the published file."""
    if not path.exists():
        raise MissingSuiteError(f"no {path}")
    root = ET.parse(path).getroot()
    view = next(root.iter("view"))
    published = {"side": float(view.attrib["maxPxcor"]) - float(view.attrib["minPxcor"]) + 1}
    for slider in root.iter("slider"):
        published[slider.attrib["variable"]] = float(slider.attrib["default"])
    ours = of(_module(name))
    problems = (
        f"{key} is {ours.get(key)}, published {value}"
        for key, value in published.items()
        if ours.get(key) != value
    )
    return judged(f"{name}: parameters", problems)


def _of_ants(ants: Any) -> Parameters:
    return {
        "side": ants.SIDE,
        "population": ants.ANTS,
        "diffusion-rate": 100 * ants.DIFFUSION,
        "evaporation-rate": 100 * ants.EVAPORATION,
    }


def _of_heatbugs(heatbugs: Any) -> Parameters:
    return {
        "side": heatbugs.SIDE,
        "bug-count": heatbugs.BUGS,
        "diffusion-rate": heatbugs.DIFFUSION,
        "evaporation-rate": heatbugs.EVAPORATION,
        "random-move-chance": 0,
        **dict(zip(("min-ideal-temp", "max-ideal-temp"), heatbugs.IDEAL, strict=True)),
        **dict(zip(("min-output-heat", "max-output-heat"), heatbugs.OUTPUT, strict=True)),
    }


def _of_aids(aids: Any) -> Parameters:
    return {
        "side": aids.SIDE,
        "initial-people": aids.PEOPLE,
        "average-coupling-tendency": aids.COUPLING,
        "average-commitment": aids.COMMITMENT,
        "average-condom-use": 0,
        "average-test-frequency": 0,
    }


def _judged_statistics(name: str) -> Iterator[Result]:
    """Whether each statistic has the same distribution on both sides."""
    from tools.acceptance.netlogo import in_mesa

    steps = STEPS[name]
    ours = [figures(name, seed, steps) for seed in range(SEEDS)]
    theirs = [getattr(in_mesa, name)(seed, steps) for seed in range(SEEDS)]
    for key in ours[0]:
        samples = ([run[key] for run in runs] for runs in (ours, theirs))
        yield compared(f"{name}: {key} after {steps} steps", *samples, ERROR / len(ours[0]))


def compared(
    case: str, ours: list[float], theirs: list[float], error: float, other: str = "Mesa"
) -> Result:
    """The result of a statistic, by the test of Kolmogorov and Smirnov of two samples.

    Args:
        case: its name.
        ours: the statistic in runs of a world.
        theirs: the same in the other program.
        error: the probability that it fails although both have the same distribution.
        other: that program.

    """
    from scipy.stats import ks_2samp

    p = float(ks_2samp(ours, theirs).pvalue)
    shown, wanted = (f"{np.mean(runs):.2f} ± {np.std(runs, ddof=1):.2f}" for runs in (ours, theirs))
    values = {"Minerva Bus": shown, other: wanted, "p": f"{p:.2f}"}
    if p < error:
        return Result(case, Outcome.FAILED, f"{shown}, in {other} {wanted} (p = {p:.1g})", values)
    return Result(case, Outcome.PASSED, "", values)


def figures(name: str, seed: int, steps: int) -> Figures:
    """The statistics of a world after some steps."""
    from tools.acceptance.netlogo import statistics

    module = _module(name)
    state = run(module.world(seed), frames=steps, seed=seed).scene.nodes[0].state
    return getattr(statistics, name)(*module.shown(state))


def _module(name: str) -> Any:
    return import_module(f"tools.acceptance.netlogo.{name}")


NETLOGO = Suite(
    "netlogo",
    "NetLogo/models",
    "Sample Models/Biology",
    "worlds written from descriptions of models: parameters, and statistics as in Mesa",
    _results,
)
