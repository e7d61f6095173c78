"""Receivers of satellite navigation that speak NMEA 0183, on a serial line."""

from minerva_services.nmea.service import Nmea

__all__ = ["Nmea"]
