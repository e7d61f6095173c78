"""What the physics world knows of a body and the string does not, as a line of text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, cast

from minerva_bus.values import fast_dataclass
from minerva_services.physics.agent_lines import AGENTS, by_agent
from minerva_services.physics.body import Body, body_of, row_of
from minerva_services.physics.errors import PhysicsError


@fast_dataclass
class KeptBody:
    """A body between two ticks.

    Attributes:
        body: its true pose, and what it has done.
        carried_out: the frame of the last view whose command it has carried out; -1 for none.
        stopped_by: what stopped it in that tick, "" for a wall; None if it was not stopped.

    """

    body: Body
    carried_out: int = -1
    stopped_by: str | None = None

    @property
    def text(self) -> str:
        """The body as one line, from which `of` makes the same numbers, to the last bit."""
        return json.dumps([*row_of(self.body), self.carried_out, self.stopped_by])

    @staticmethod
    def of(text: str) -> KeptBody:
        """Inverse of `text`. Raises PhysicsError for another one."""
        try:
            *row, carried_out, stopped_by = cast("list[Any]", json.loads(text))
            if not (stopped_by is None or isinstance(stopped_by, str)):
                raise TypeError("a body is stopped by a name")
            return KeptBody(body_of(row), int(carried_out), stopped_by)
        except PhysicsError:
            raise
        except (TypeError, ValueError) as error:
            raise PhysicsError(f"not the saved state of a body: {error!r}") from error


def kept_bodies(saved: Mapping[str, Any]) -> dict[str, KeptBody]:
    """The bodies in what a physics world has saved, by name. Raises PhysicsError for other data."""
    try:
        lines = by_agent(saved[AGENTS])
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise PhysicsError(f"not the saved state of a physics world: {error!r}") from error
    return {name: KeptBody.of(text) for name, text in sorted(lines.items())}
