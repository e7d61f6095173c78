"""Sensors: devices and files whose readings become events (Table 4)."""
