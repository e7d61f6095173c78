"""The state of an arena as plain values for msgpack."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypedDict

from minerva_services.physics.body import Body, BodyPose, DriveCommand, Odometer
from minerva_services.physics.errors import PhysicsError, finite, positive


class SavedArena(TypedDict):
    """Numbers only, keyed by the bodies' names.

    `bodies`: x, y (m), angle (deg), radius (m), driven (m), collisions. `commands`: turn (deg) and
    forward (m) of pending commands. `seconds`: simulated time.
    """

    seconds: float
    bodies: dict[str, list[float]]
    commands: dict[str, list[float]]


def saved(
    seconds: float, bodies: Mapping[str, Body], commands: Mapping[str, DriveCommand]
) -> SavedArena:
    """The plain values of a state, sorted by name."""
    return {
        "seconds": seconds,
        "bodies": {name: _row(bodies[name]) for name in sorted(bodies)},
        "commands": {
            name: [commands[name].turn_deg, commands[name].forward_m] for name in sorted(commands)
        },
    }


def restored(value: SavedArena) -> tuple[float, dict[str, Body], dict[str, DriveCommand]]:
    """Inverse of `saved`: seconds, bodies and commands.

    Raises:
        PhysicsError: the value was not written by `saved`.

    """
    try:
        bodies = {name: _body(row) for name, row in sorted(value["bodies"].items())}
        commands = {name: _command(row) for name, row in sorted(value["commands"].items())}
        seconds = float(value["seconds"])
    except PhysicsError:
        raise
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise PhysicsError(f"not the saved state of an arena: {error!r}") from error
    finite("saved state, seconds", seconds)
    if unknown := sorted(commands.keys() - bodies.keys()):
        raise PhysicsError(f"saved state: commands for unknown bodies: {unknown}")
    return seconds, bodies, commands


def _row(body: Body) -> list[float]:
    pose, odometer = body.pose, body.odometer
    return [pose.x, pose.y, pose.angle, body.radius, odometer.driven_m, odometer.collisions]


def _body(row: list[float]) -> Body:
    x, y, angle, radius, driven, collisions = map(float, row)
    finite("saved state, a body", x, y, angle, driven, collisions)
    positive("saved state, a radius in metres", radius)
    return Body(BodyPose(x, y, angle), radius, Odometer(driven, int(collisions)))


def _command(row: list[float]) -> DriveCommand:
    turn, forward = map(float, row)
    finite("saved state, a command", turn, forward)
    return DriveCommand(turn, forward)
