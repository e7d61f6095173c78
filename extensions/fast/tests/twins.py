"""A kind of agents in two forms, uncompiled and compiled, and frames that compare their results."""

from __future__ import annotations

from typing import Any

from minerva_bus import evolve as eta
from minerva_bus.errors import MinervaError
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.text_and_digest import scene_digest
from minerva_bus.world.class_declaration import compile_all
from minerva_bus.world.context import Frame


def compiled_form(kind):
    """The same kind of agents with compiled methods."""
    form = type(kind.__name__, (kind,), {})
    compile_all(form, True)
    return form


def outcome(scene, events, kinds, frame) -> Any:
    """The string and the emitted events of a frame, or the text of its error."""
    try:
        evolved = eta(scene, events, kinds, frame)
    except MinervaError as error:
        return type(error).__name__, str(error), str(error.__cause__)
    sent = {}
    for event in single([*(e for own in evolved.emitted.values() for e in own), *evolved.batches]):
        sent.setdefault((event.type, event.sender), []).append(str(event))
    return evolved.scene, sent


def unpacked(scene):
    """The string with a node for each agent, which evolves agent by agent."""
    return Scene(scene.nodes)


def same(kind, scene, frames, *, parts=2) -> Any:
    """Assert that both forms give the same string in each frame; returns the last outcome.

    Args:
        kind: the class of the agents, without compilation.
        scene: the string at the start.
        frames: the events of each frame; a function of the frame's number.
        parts: the compiled agents are also evolved in so many separate parts, as by several hosts.

    """
    compiled, result = compiled_form(kind), None
    for number, events in enumerate(frames):
        frame = Frame(number, 0.1, 7)
        result = outcome(unpacked(scene), events, [kind], frame)
        both = outcome(scene, events, [compiled], frame)
        if isinstance(result[0], str):
            assert both == result, (both, result)
            return result
        assert str(both[0]) == str(result[0])
        assert scene_digest(both[0]) == scene_digest(result[0])
        assert both[1] == result[1]
        split = [outcome(part, events, [compiled], frame)[0].nodes for part in _split(scene, parts)]
        assert str(Scene(tuple(node for part in split for node in part))) == str(result[0])
        scene = both[0]
    return result


def _split(scene, parts):
    for piece in scene.pieces:
        if piece.count < parts:
            yield Scene((piece,))
            continue
        step = -(-piece.count // parts)
        for begin in range(0, piece.count, step):
            yield Scene((piece.take(slice(begin, begin + step)),))
