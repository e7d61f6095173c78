"""Models of FMI 3 (FMUs) in a world."""

from minerva_services.bridges.fmu.service import Fmu

__all__ = ["Fmu"]
