"""A physics world: walls, bodies, lasers, cameras and their errors.

Only `service` knows the bus; all other modules are pure.
"""
