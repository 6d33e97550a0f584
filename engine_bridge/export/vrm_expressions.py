"""Facial expressions of a VRM humanoid from the names of morph targets (VRMC_vrm 1.0, expressions)."""

from collections.abc import Iterator
from typing import Any

from engine_bridge.character.face_targets import EXPRESSION_TARGETS
from engine_bridge.character.schema import Gltf

GAZE = ("lookUp", "lookDown", "lookLeft", "lookRight")
"""Expressions that move the eyes."""


def expressions(gltf: Gltf) -> dict[str, dict[str, Any]]:
    """Return VRM's expressions for the named morph targets of a file.

    Each named target also is an expression of its own under its name, as face tracking drives ARKit's.

    Returns
    -------
    dict
        The property `expressions`: ``preset`` and ``custom``, if they are not empty.
    """
    named: dict[str, list[dict[str, Any]]] = {}
    in_any_case: dict[str, list[dict[str, Any]]] = {}
    for name, bind in _binds(gltf):
        named.setdefault(name, []).append(bind)
        in_any_case.setdefault(name.lower(), []).append(bind)
    preset = {}
    for expression, choices in EXPRESSION_TARGETS.items():
        rows = [[in_any_case.get(name.lower(), []) for name in names] for names in choices]
        chosen = next((row for row in rows if all(row)), None)
        if chosen is not None:
            preset[expression] = _expression([bind for binds in chosen for bind in binds])
    reserved = {name.lower() for name in EXPRESSION_TARGETS}
    custom = {name: _expression(binds) for name, binds in named.items() if name.lower() not in reserved}
    return {kind: found for kind, found in (("preset", preset), ("custom", custom)) if found}


def _expression(binds: list[dict[str, Any]]) -> dict[str, Any]:
    return {"morphTargetBinds": binds}


def _binds(gltf: Gltf) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each named morph target of each node's mesh, with what binds an expression to it."""
    for node, table in enumerate(gltf["nodes"]):
        if "mesh" not in table:
            continue
        mesh = gltf["meshes"][table["mesh"]]
        extras = mesh.get("extras")
        targets = mesh["primitives"][0].get("targets", []) if mesh["primitives"] else []
        names = extras.get("targetNames") if isinstance(extras, dict) else None
        for index, name in enumerate(names[: len(targets)] if isinstance(names, list) else []):
            if isinstance(name, str) and name:
                yield name, {"node": node, "index": index, "weight": 1.0}
