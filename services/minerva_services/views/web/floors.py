"""Matrices on the page: those with a height as floors with walls, others as flat images."""

from __future__ import annotations

from typing import TypeAlias

from viser import ImageHandle, MeshHandle, SceneApi

from minerva_bus.semantics.picture import Tiles
from minerva_services.views.floor_parts import Floor, floor_meshes, image, named_floors
from minerva_services.views.solids import upright

_Nodes: TypeAlias = "list[MeshHandle | ImageHandle]"


class FloorNodes:
    """Nodes of all matrices, rebuilt only when a matrix changes."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._shown: dict[str, tuple[Floor, _Nodes]] = {}

    def show(self, matrices: list[Tiles]) -> None:
        """Show exactly these."""
        floors = named_floors(matrices)
        for name in [name for name in self._shown if name not in floors]:
            for node in self._shown.pop(name)[1]:
                node.remove()
        for name, floor in floors.items():
            self._show(name, floor)

    def _show(self, name: str, floor: Floor) -> None:
        before, nodes = self._shown.get(name, (None, []))
        if before is not None and before.is_same(floor):
            return
        # Only an image can be replaced in place; meshes are built again. A floor without coloured
        # cells has no node at all.
        node = nodes[0] if nodes and before is not None and before.is_at(floor) else None
        if isinstance(node, ImageHandle):
            node.image = image(floor.tiles)
        else:
            for node in nodes:
                node.remove()
            build = self._built if floor.tiles.form.height else self._laid
            nodes = build(name, floor)
        self._shown[name] = floor, nodes

    def _built(self, name: str, floor: Floor) -> _Nodes:
        """A floor with walls where cells are above 0."""
        pose, form = floor.tiles.pose, floor.tiles.form
        return [
            self._scene.add_mesh_simple(
                f"{name}/{mesh.name}",
                mesh.solid.vertices,
                mesh.solid.faces,
                color=mesh.color,
                opacity=form.opacity if form.opacity < 1 else None,
                flat_shading=True,
                cast_shadow=mesh.walls,
                position=(pose.x, pose.y, 0.0),
                wxyz=upright(pose.angle),
            )
            for mesh in floor_meshes(floor.tiles)
        ]

    def _laid(self, name: str, floor: Floor) -> _Nodes:
        """An image that lies on the ground."""
        tiles = floor.tiles
        width, depth = tiles.size
        middle = tiles.pose.then(width / 2, depth / 2)
        laid = self._scene.add_image(
            name,
            image(tiles),
            width,
            depth,
            # JPEG has no transparency.
            format="png",
            cast_shadow=False,
            receive_shadow=False,
            position=(middle.x, middle.y, floor.height),
            wxyz=upright(tiles.pose.angle),
        )
        return [laid]
