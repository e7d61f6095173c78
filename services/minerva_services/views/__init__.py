"""Views: geometries that render a world as pictures, pages, windows and sound.

A new view is a package or module here, and an entry point `minerva.services` in pyproject.toml.
"""
