"""Simulators of mosaik in a world."""

from minerva_cosimulation.mosaik_service.service import Mosaik

__all__ = ["Mosaik"]
