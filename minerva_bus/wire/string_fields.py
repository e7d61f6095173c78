"""Codecs of fields with strings, whole or patched: fragments, views and the skeleton."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame.messages import Mark
from minerva_bus.grammar.scene import Scene
from minerva_bus.wire.columns import is_patch, plain_patch
from minerva_bus.wire.field_codec import DeclaredField, FieldCodec
from minerva_bus.wire.plain import as_map
from minerva_bus.wire.reader import Reader
from minerva_bus.wire.values import plain_scene

_NO_PATCHES: Final[m.Patches] = {}


def _write_parts(parts: m.Parts, patches: m.Patches = _NO_PATCHES) -> dict[str, Any]:
    plain: dict[str, Any] = {}
    if parts:
        plain = {name: plain_scene(scene) for name, scene in parts.items()}
    # Encoded in one map with whole strings: a fragment or view is either changed or patched.
    if patches:
        plain.update((name, plain_patch(patch)) for name, patch in patches.items())
    return plain


def whole_parts(of: DeclaredField) -> FieldCodec:
    """Strings by id, without the patches in the same map."""
    what, view = of.what, of.has(Mark.VIEW)

    def read(reader: Reader, plain: Any) -> m.Parts:
        scene = reader.view if view else reader.scene
        parts = as_map(plain, what)
        if not parts:
            return {}
        # Strings and patches share one map; the field for patches reads the others.
        return {name: scene(part) for name, part in parts.items() if not is_patch(part)}

    return FieldCodec("{id: string}", read, _write_parts)


def part_patches(of: DeclaredField) -> FieldCodec:
    """Patches by id, without the whole strings in the same map."""

    def read(reader: Reader, plain: Any) -> m.Patches:
        parts = as_map(plain, of.what)
        if not parts:
            return {}
        return {name: reader.columns.patch(part) for name, part in parts.items() if is_patch(part)}

    return FieldCodec("{id: patch}", read)


def whole_views(of: DeclaredField) -> FieldCodec:
    """Strings by id for each visual event type, without patches."""
    parts = whole_parts(of)

    def read(reader: Reader, plain: Any) -> Mapping[str, m.Parts]:
        return {name: parts.read(reader, view) for name, view in as_map(plain, of.what).items()}

    def write(views: Mapping[str, m.Parts], patches: Mapping[str, m.Patches]) -> Any:
        if not views:
            return {}
        # Every type with patches is in `views` as well, if only with an empty map.
        return {
            name: _write_parts(view, patches.get(name, _NO_PATCHES)) for name, view in views.items()
        }

    return FieldCodec("{event type: {id: string}}", read, write)


def view_patches(of: DeclaredField) -> FieldCodec:
    """Patches by id for each visual event type, without whole strings."""
    patches = part_patches(of)

    def read(reader: Reader, plain: Any) -> Mapping[str, m.Patches]:
        views = {name: patches.read(reader, v) for name, v in as_map(plain, of.what).items()}
        return {name: view for name, view in views.items() if view}

    return FieldCodec("{event type: {id: patch}}", read)


def skeleton_or_nil(of: DeclaredField) -> FieldCodec:
    """A string, with slots if the field allows them, or nil."""

    def read(reader: Reader, plain: Any) -> Scene | None:
        if plain is None:
            return None
        return reader.skeleton(plain) if of.has(Mark.SLOTS) else reader.scene(plain)

    def write(scene: Scene | None) -> Any:
        return None if scene is None else plain_scene(scene)

    return FieldCodec("string or nil", read, write)
