"""Satellite navigation receivers that speak NMEA 0183, on a serial line."""

from minerva_services.sensors.nmea.service import Nmea

__all__ = ["Nmea"]
