"""Compiled views of agents in columns: figures as columns, or None if Python must run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from minerva_bus.compiled.activity import CompiledViews
from minerva_bus.compiled.form import Figure, Shown
from minerva_bus.compiled.writing import FAULT
from minerva_bus.grammar.columns import Rows
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY, Node, Scene
from minerva_bus.world.compiled_rows import KernelCall
from minerva_bus.world.population import PopulationState, Turn


def compiled_view(
    views: CompiledViews,
    state: PopulationState,
    rows: Rows,
    event: Event,
    one_each: Callable[[Scene, int], Scene],
) -> Scene | None:
    """The views of these rows; None if the method itself must run, such as to raise its error.

    Args:
        views: the compiled views of the agents' class.
        state: the agents.
        rows: those that show something for this event.
        event: an event for all.
        one_each: a string with the nodes of each of n agents, from one with columns of n rows.

    """
    program, kernel = views.kernel(event.type)
    call = KernelCall(program, state, Turn(event, rows))
    if not call.fits or (call.run(kernel, None, None) == FAULT).any():
        return None
    shown: list[tuple[Rows, Scene]] = []
    for index, output in enumerate(program.outputs):
        place, *values = call.cells_of(index)
        if len(place) and isinstance(output, Shown):
            named = call.decoded(output, values) | call.shared(output, place)
            arrays = iter([named[number] for number in sorted(named, key=int)])
            figures = [_figure(figure, arrays) for figure in output.figures]
            whole = Scene(tuple([piece for figure in figures for piece in figure.pieces]))
            shown.append((place, one_each(whole, len(place))))
    if len(shown) <= 1:
        return shown[0][1] if shown else EMPTY
    return _in_order(shown)


def _figure(figure: Figure, arrays: Iterator[Any]) -> Scene:
    """A figure for each row; its parameters are the next arrays."""
    given = {name: next(arrays) for name in figure.names}
    if not hasattr(figure.symbol, "motion"):
        return figure.symbol(**given)
    inside = [_figure(inner, arrays) for inner in figure.scope]
    return figure.symbol(**given)(*inside)


def _in_order(shown: list[tuple[Rows, Scene]]) -> Scene:
    """Views of several forms by the places of their agents."""
    nodes: dict[int, list[Node]] = {}
    for places, scene in shown:
        every = scene.nodes
        step = len(every) // len(places)
        for number, place in enumerate(places.tolist()):
            nodes[place] = list(every[number * step : (number + 1) * step])
    return Scene(tuple([node for place in sorted(nodes) for node in nodes[place]]))
