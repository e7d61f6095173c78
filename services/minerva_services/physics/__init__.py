"""The physics world: walls, bodies, a laser, a camera and their noise.

`service` puts it on the bus; all else knows nothing of a bus.
"""
