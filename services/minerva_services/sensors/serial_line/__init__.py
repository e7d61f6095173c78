"""Serial lines for bridges: opening, reading, and error handling."""

from minerva_services.sensors.serial_line.line import SerialLine, check_installed, open_line
from minerva_services.sensors.serial_line.splitter import LineSplitter

__all__ = ["LineSplitter", "SerialLine", "check_installed", "open_line"]
