"""Rigid bodies in space: forms with mass, joints, and the service `bodies` that moves them.

A world's vocabulary declares solids and motions by the forms here; the service `bodies` gives their
string a meaning in Rapier's space, as `physics` does in the plane.
"""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_bodies.cameras import Camera
    from minerva_bodies.forms import (
        Ball,
        Box,
        Capsule,
        Command,
        Cone,
        Cylinder,
        Joint,
        Matter,
        Mesh,
        Poster,
        Terrain,
        euler,
        quaternion,
    )
    from minerva_bodies.rigid import Rigid
    from minerva_bodies.sensors import Distance, Gps, Imu, Lidar

_HOMES = {
    "cameras": "Camera",
    "forms": (
        "Ball Box Capsule Command Cone Cylinder Joint Matter Mesh Poster Terrain euler quaternion"
    ),
    "rigid": "Rigid",
    "sensors": "Distance Gps Imu Lidar",
}
__getattr__ = imported_at_first_use(__name__, _HOMES)

__all__ = [
    "Ball",
    "Box",
    "Camera",
    "Capsule",
    "Command",
    "Cone",
    "Cylinder",
    "Distance",
    "Gps",
    "Imu",
    "Joint",
    "Lidar",
    "Matter",
    "Mesh",
    "Poster",
    "Rigid",
    "Terrain",
    "euler",
    "quaternion",
]
