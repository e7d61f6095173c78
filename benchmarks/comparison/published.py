"""Published results of systems that are not run here: times relative to Agents.jl 6.2.10 = 1.

Source: JuliaDynamics/ABMFrameworksComparison, table of 2026-02-22 (Ark.jl 0.4.0, MASON 22,
NetLogo 6.4.0, Mesa 3.2.0). Lines of code are as published, without NetLogo's interface section.
"""

from __future__ import annotations

from typing import Final

TIMES: Final[dict[tuple[str, str], dict[str, float]]] = {
    ("wolf_sheep", "small"): {
        "agents.jl": 1, "ark.jl": 0.34, "mason": 5.29, "netlogo": 9.94, "mesa": 9.38,
    },
    ("wolf_sheep", "large"): {
        "agents.jl": 1, "ark.jl": 0.14, "mason": 7.8, "netlogo": 4.81, "mesa": 3.28,
    },
    ("flocking", "small"): {
        "agents.jl": 1, "ark.jl": 0.73, "mason": 1.42, "netlogo": 15.37, "mesa": 159.29,
    },
    ("flocking", "large"): {
        "agents.jl": 1, "ark.jl": 0.36, "mason": 0.61, "netlogo": 19.14, "mesa": 59.5,
    },
    ("schelling", "small"): {
        "agents.jl": 1, "ark.jl": 0.61, "mason": 1.19, "netlogo": 11.39, "mesa": 29.73,
    },
    ("schelling", "large"): {
        "agents.jl": 1, "ark.jl": 0.59, "mason": 1.51, "netlogo": 14.33, "mesa": 26.66,
    },
}  # fmt: skip
LINES: Final[dict[str, dict[str, int]]] = {
    "wolf_sheep": {"agents.jl": 73, "ark.jl": 149, "mason": 202, "netlogo": 137, "mesa": 118},
    "flocking": {"agents.jl": 42, "ark.jl": 137, "mason": 159, "netlogo": 82, "mesa": 94},
    "schelling": {"agents.jl": 26, "ark.jl": 78, "mason": 129, "netlogo": 54, "mesa": 33},
}
