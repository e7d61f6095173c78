"""Serial lines for bridges: opening, reading, and error handling."""

from minerva_services.sensors.serial_line.line import LineSplitter, SerialLine, open_line

__all__ = ["LineSplitter", "SerialLine", "open_line"]
