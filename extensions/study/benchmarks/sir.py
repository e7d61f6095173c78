"""CPU time and curves of the SIR model of examples/sir, ours beside that of Mesa, in one run.

    python -m extensions.study.benchmarks.sir [--turns 5] [--mesa PYTHON] [--json]
    python -m extensions.study.benchmarks.sir --plot docs/migration/sir.png [--seeds 20]

Each turn starts both programs as new processes, one after the other. `program` is the CPU time of
the whole process: start of Python, imports, model, 300 frames, table. `frames` is that of the 300
frames with collected data, measured within the process. Compare the ratios; seconds depend on the
machine. `--mesa` names the Python of another environment, for example with Mesa 4.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import PLOT, Option, Table, options
from minerva_analysis.plotting import COLORS, draw, label_ends, show_grid

FOLDER: Final = Path(__file__).parents[3] / "examples" / "sir"
FRAMES: Final = 300
OURS: Final = f"""
import sir, time
from minerva_bus import run
began = time.process_time()
run(sir.world, frames={FRAMES}, seed=7, collect=sir.curves)
print(time.process_time() - began)
"""
MESA: Final = f"""
import sir_mesa, time
began = time.process_time()
sir_mesa.simulate({FRAMES}, seed=7)
print(time.process_time() - began)
"""
PROGRAMS: Final = {"Minerva Bus": ("sir.py", OURS), "Mesa": ("sir_mesa.py", MESA)}
COLUMNS: Final = {"part": "<8", "system": "<12", "CPU s": ">6.2f", "from": ">6.2f", "to": ">6.2f",
                  "ratio": ">6.2f"}  # fmt: skip

Curves = NDArray[np.int64]


def cpu_seconds(words: list[str]) -> tuple[float, str]:
    """CPU time of a new process, with that of its children, and its output."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(words, cwd=FOLDER, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{' '.join(words)[:80]}\n{done.stderr[-500:]}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def measured(turns: int, pythons: dict[str, str]) -> dict[str, dict[str, list[float]]]:
    """CPU seconds of each turn, by part and system."""
    seconds: dict[str, dict[str, list[float]]] = {
        part: {system: [] for system in PROGRAMS} for part in ("program", "frames")
    }
    for _ in range(turns):
        for system, (program, frames) in PROGRAMS.items():
            whole, _ = cpu_seconds([pythons[system], program])
            _, inner = cpu_seconds([pythons[system], "-c", frames])
            seconds["program"][system].append(whole)
            seconds["frames"][system].append(float(inner))
    return seconds


def curves_of(seeds: int) -> dict[str, Curves]:
    """People who are sick and immune: (seeds, 2, FRAMES + 1) for each system."""
    sys.path.insert(0, str(FOLDER))
    import sir
    import sir_mesa

    from minerva_bus import run

    ours: list[list[NDArray[np.int64]]] = []
    theirs: list[list[NDArray[np.int64]]] = []
    for seed in range(seeds):
        table = run(sir.world, frames=FRAMES, seed=seed, collect=sir.curves).table()
        frame = sir_mesa.simulate(FRAMES, seed)
        ours.append([np.asarray(table[name], np.int64) for name in ("sick", "immune")])
        theirs.append([frame[name].to_numpy(np.int64) for name in ("sick", "immune")])
    return {"Minerva Bus": np.array(ours), "Mesa": np.array(theirs)}


def plotted(file: Path, curves: dict[str, Curves]) -> None:
    """Draw each run as a thin line, and the means of both systems as thick lines."""

    def paint(figure: Any) -> None:
        axes = figure.subplots(1, 2, sharex=True)
        for number, (axis, title) in enumerate(zip(axes, ("sick", "immune"), strict=True)):
            ends: list[tuple[float, str, str]] = []
            for (system, runs), color in zip(curves.items(), COLORS, strict=False):
                mean = runs[:, number].mean(axis=0)
                axis.plot(runs[:, number].T, color=color, alpha=0.15, linewidth=0.8)
                axis.plot(mean, color=color, linewidth=2.2)
                ends.append((float(mean[-1]), system, color))
            axis.set(title=title, xlabel="frame", xlim=(0, FRAMES))
            show_grid(axis)
            label_ends(axis, ends)
        axes[0].set_ylabel("people, of 200")

    draw(file, (11, 3.9), paint)


def main() -> None:
    given = options(
        __doc__, turns=5, plot=PLOT, seeds=Option(20, "runs in the picture and its table"),
        mesa=Option(sys.executable, "the Python that has Mesa"),
    )  # fmt: skip
    if given.plot:
        curves = curves_of(given.seeds)
        plotted(given.plot, curves)
        for system, runs in curves.items():
            peaks, immune = runs[:, 0].max(axis=1), runs[:, 1, -1]
            error = len(runs) ** -0.5
            most = f"{peaks.mean():.0f} ± {peaks.std() * error:.0f}"
            last = f"{immune.mean():.0f} ± {immune.std() * error:.0f}"
            print(f"{system:<12} most sick {most}, in the end immune {last}")
        return
    table = Table(COLUMNS, as_json=given.json)
    pythons = {"Minerva Bus": sys.executable, "Mesa": given.mesa}
    for part, systems in measured(given.turns, pythons).items():
        medians = {system: statistics.median(values) for system, values in systems.items()}
        for system, values in systems.items():
            ratio = medians[system] / medians["Minerva Bus"]
            row = {"part": part, "system": system, "cpu_s": medians[system], "from": min(values),
                   "to": max(values), "ratio": ratio}  # fmt: skip
            table.row(row)


if __name__ == "__main__":
    main()
