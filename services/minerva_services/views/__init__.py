"""Views: geometries that render a world as pictures, pages, windows and sound."""
