"""Who touches whom: collisions from the geometry of the scene, as events (section 5)."""

from minerva_services.collisions.service import Collisions

__all__ = ["Collisions"]
