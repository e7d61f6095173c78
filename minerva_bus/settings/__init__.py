"""The settings of a world: declared once, read from a world file and a command line.

A new setting is a field in settings/world_settings.py, and `python -m tools.settings_tables`
documents it.
"""
