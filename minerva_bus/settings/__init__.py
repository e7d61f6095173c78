"""The settings of a world: declared once, read from a world file and a command line."""
