"""Serial lines for bridges: opening, reading, and error handling."""

from minerva_services.sensors.serial_line.line import (
    LineSplitter,
    SerialLine,
    check_installed,
    open_line,
)

__all__ = ["LineSplitter", "SerialLine", "check_installed", "open_line"]
