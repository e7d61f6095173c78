"""Serial lines of bridges: opened by their path, read in what parts they come, lost and found."""

from minerva_services.sensors.serial_line.line import SerialLine, check_installed, open_line
from minerva_services.sensors.serial_line.lines import Lines

__all__ = ["Lines", "SerialLine", "check_installed", "open_line"]
