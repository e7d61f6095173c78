"""Who is near whom: what agents see of one another, as events."""

from minerva_services.physics.neighbours.service import Neighbours

__all__ = ["Neighbours"]
