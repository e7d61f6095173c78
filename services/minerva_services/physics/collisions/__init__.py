"""Collisions from the geometry of the scene, as events (section 5)."""

from minerva_services.physics.collisions.service import Collisions

__all__ = ["Collisions"]
