"""SLAMTEC RPLIDAR A-series laser scanners, on a serial line."""

from minerva_services.sensors.rplidar.service import Rplidar

__all__ = ["Rplidar"]
