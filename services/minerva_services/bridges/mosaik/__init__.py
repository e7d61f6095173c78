"""Simulators of mosaik in a world."""

from minerva_services.bridges.mosaik.service import Mosaik

__all__ = ["Mosaik"]
