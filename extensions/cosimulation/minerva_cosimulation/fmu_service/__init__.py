"""Models of FMI 2 and 3 (FMUs) in a world."""

from minerva_cosimulation.fmu_service.service import Fmu

__all__ = ["Fmu"]
