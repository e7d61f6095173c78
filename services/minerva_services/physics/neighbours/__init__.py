"""Neighbours: what agents perceive of each other, as events."""

from minerva_services.physics.neighbours.service import Neighbours

__all__ = ["Neighbours"]
