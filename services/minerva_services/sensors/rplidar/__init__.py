"""RPLIDAR laser scanners of SLAMTEC's A series, on a serial line."""

from minerva_services.sensors.rplidar.service import Rplidar

__all__ = ["Rplidar"]
