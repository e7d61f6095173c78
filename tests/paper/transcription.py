"""Literal transcription of equations 1 to 6 and Table 2 of the paper.

Each function is its equation, case by case, recursive and slow. It documents the
paper, and a differential test compares the engine with it. λ and θ are functions, as in
the paper: `lam(agent, event)` and `theta(agent, event)`. `eta_sequential` is the default reading of
equation 3 (docs/decisions/paper.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY, AgentNode, FigureNode, Scene, TransformationNode
from minerva_bus.grammar.scene import with_scope as around

Lambda = Callable[[AgentNode, Event], Scene]
Generators = Sequence[Callable[[int], Sequence[Event]]]


def parts(w: Scene) -> tuple[Scene, Scene]:
    """w = s · v with s a single object."""
    return Scene(w.nodes[:1]), Scene(w.nodes[1:])


def phi(
    w: Scene,
    alpha: Callable[[FigureNode], None],
    beta: Callable[[TransformationNode], None],
    delta: Callable[[TransformationNode], None],
) -> None:
    """Equation 1."""
    if w == EMPTY:
        return
    s, v = parts(w)
    if v != EMPTY:
        phi(s, alpha, beta, delta)
        phi(v, alpha, beta, delta)
        return
    (node,) = s.nodes
    if isinstance(node, FigureNode):
        alpha(node)
    elif isinstance(node, TransformationNode):
        beta(node)
        phi(node.scope, alpha, beta, delta)
        delta(node)


def eta(w: Scene, events: Sequence[Event], lam: Lambda) -> Scene:
    """Equation 3, literally: one copy of an agent for each event."""
    if w == EMPTY:
        return EMPTY
    s, t = parts(w)
    if t != EMPTY:
        return eta(s, events, lam) + eta(t, events, lam)
    (node,) = s.nodes
    if isinstance(node, FigureNode):
        return s
    if isinstance(node, TransformationNode):
        return Scene((around(node, eta(node.scope, events, lam)),))
    # The scope first: the equation applies λ to a^d_st(η(v)).
    agent = around(node, eta(node.scope, events, lam))
    result = EMPTY
    for f in events:
        result = result + lam(agent, f)
    return result


def eta_sequential(w: Scene, events: Sequence[Event], lam: Lambda) -> Scene:
    """Equation 3 with the events of an agent applied in sequence; without events it stays."""
    if w == EMPTY:
        return EMPTY
    s, t = parts(w)
    if t != EMPTY:
        return eta_sequential(s, events, lam) + eta_sequential(t, events, lam)
    (node,) = s.nodes
    if isinstance(node, FigureNode):
        return s
    if isinstance(node, TransformationNode):
        return Scene((around(node, eta_sequential(node.scope, events, lam)),))
    result = Scene((around(node, eta_sequential(node.scope, events, lam)),))
    for f in events:
        result = apply_to(result, node.id, f, lam)
    return result


def apply_to(w: Scene, agent: str, f: Event, lam: Lambda) -> Scene:
    """w with λ applied to one of its agents, at any depth."""
    result = EMPTY
    for node in w.nodes:
        if isinstance(node, AgentNode) and node.id == agent:
            result = result + lam(node, f)
        elif isinstance(node, FigureNode):
            result = result + Scene((node,))
        else:
            result = result + Scene((around(node, apply_to(node.scope, agent, f, lam)),))
    return result


def pi(w: Scene, events: Sequence[Event], theta: Lambda) -> Scene:
    """Equation 5."""
    if w == EMPTY:
        return EMPTY
    s, t = parts(w)
    if t != EMPTY:
        return pi(s, events, theta) + pi(t, events, theta)
    (node,) = s.nodes
    if isinstance(node, FigureNode):
        return s
    if isinstance(node, TransformationNode):
        return Scene((around(node, pi(node.scope, events, theta)),))
    agent = around(node, pi(node.scope, events, theta))
    result = EMPTY
    for f in events:
        result = result + theta(agent, f)
    return result


def collect(generators: Generators, t: int) -> tuple[Event, ...]:
    """Equation 6: E(C*, t), with e(z, e^i) that adds an event that is not in z."""
    if not generators:
        return ()
    *rest, last = generators
    z = collect(rest, t)
    for e in last(t):
        # e(z, e^i) of equation 6.
        z = z if e in z else (*z, e)
    return z


def system(
    w0: Scene,
    generators: Generators,
    visual: Callable[[Event], bool],
    lam: Lambda,
    theta: Lambda,
    phi_g: Callable[[Scene], None],
    evolved: Callable[[Scene, Sequence[Event], Lambda], Scene] = eta_sequential,
) -> Iterator[Scene]:
    """Table 2, step by step; yields w of every frame. `evolved` is the reading of equation 3."""
    w, t = w0, 0  # 1
    while True:
        yield w
        e = collect(generators, t)  # 2
        e_v = [event for event in e if visual(event)]  # 3
        e_u = [event for event in e if not visual(event)]  # 4
        w_next = evolved(w, e_u, lam)  # 5
        v = pi(w, e_v, theta)  # 6
        phi_g(v)  # 7
        w, t = w_next, t + 1  # 8
        if w == EMPTY:  # 9
            return  # 11
        # 10: go to 2
