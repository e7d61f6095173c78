"""Logs of the CARMEN robot navigation toolkit, played into a world."""

from minerva_services.sensors.carmen.log import CarmenLog, open_log
from minerva_services.sensors.carmen.service import Carmen

__all__ = ["Carmen", "CarmenLog", "open_log"]
