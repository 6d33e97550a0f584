"""play_blender.py FILE N OUTBASE [FPS]: import a .glb into Blender as a user does, play it and write what it shows.

Runs in an environment with bpy (make peers). Nothing is touched between the import and the play: no track is unmuted,
no action is assigned. The N times are evenly spaced from 0 to the end of the active action. OUTBASE.bin holds
little-endian float32: for each mesh object (N, V, 3) world positions in glTF's axes. OUTBASE.json holds the times, the
meshes (object name, node in the file, count V, start of the block in floats, shape keys) and how the scene is set up.
FPS is the scene's frame rate before the import, 30 if it is not given.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np

HELPERS = "glTF_not_exported"
"""The importer's own collection, for the shapes that it draws bones with."""


class NoteNodes:
    """An extension of the importer that notes which node of the file an object shows the mesh of."""

    def gather_import_node_after_hook(self, vnode, _node, thing, _gltf):
        if thing.type == "MESH":
            thing["node"] = vnode.mesh_node_idx


def owners():
    """Yield all that an imported animation can move: objects and the shape keys of meshes."""
    for thing in bpy.context.scene.objects:
        yield thing.name, thing
        if thing.type == "MESH" and thing.data.shape_keys:
            yield thing.name, thing.data.shape_keys


def describe_owner(name, owner):
    data = owner.animation_data
    return {
        "object": name,
        "kind": owner.id_type,
        "action": data.action.name if data.action else None,
        "slot": data.action_slot.name_display if data.action_slot else None,
        "tracks": [{"name": track.name, "mute": track.mute} for track in data.nla_tracks],
    }


def describe_keys(thing):
    """Describe shape keys: the slider's range, and the range that the active action asks for."""
    keys = thing.data.shape_keys
    if keys is None:
        return []
    asked = {}
    if keys.animation_data and keys.animation_data.action:
        slot = keys.animation_data.action_slot
        for layer in keys.animation_data.action.layers:
            for curve in layer.strips[0].channelbag(slot).fcurves:
                values = np.empty(2 * len(curve.keyframe_points), dtype=np.float32)
                curve.keyframe_points.foreach_get("co", values)
                asked[curve.data_path] = [float(values[1::2].min()), float(values[1::2].max())]
    return [
        {
            "name": key.name,
            "slider": [key.slider_min, key.slider_max],
            "asked": asked.get(f'key_blocks["{bpy.utils.escape_identifier(key.name)}"].value'),
        }
        for key in keys.key_blocks[1:]
    ]


def positions(thing, depsgraph):
    """Return a mesh object's (V, 3) vertices as they are shown."""
    shown = thing.evaluated_get(depsgraph)
    mesh = shown.to_mesh()
    local = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", local)
    shown.to_mesh_clear()
    to_world = np.array(shown.matrix_world)
    x, y, z = (local.reshape(-1, 3).astype(np.float64) @ to_world[:3, :3].T + to_world[:3, 3]).T
    return np.column_stack([x, z, -y]).astype("<f4")


def main():
    file, count, base = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    fps = int(sys.argv[4]) if len(sys.argv) > 4 else 30
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = fps
    sys.modules["io_scene_gltf2"].glTF2ImportUserExtension = NoteNodes  # the importer asks the modules of all add-ons
    bpy.ops.import_scene.gltf(filepath=str(file))

    helpers = bpy.data.collections.get(HELPERS)
    shapes = helpers.objects if helpers else ()
    meshes = [thing for thing in scene.objects if thing.type == "MESH" and thing.name not in shapes]
    moved = [describe_owner(name, owner) for name, owner in owners() if owner.animation_data]
    active = {entry["action"] for entry in moved} - {None}
    end = max((bpy.data.actions[name].frame_range[1] for name in active), default=0.0)

    frames = np.linspace(0, end, count)
    shown = [[] for _ in meshes]
    for frame in frames:
        whole = int(np.floor(frame))
        scene.frame_set(whole, subframe=float(frame - whole))
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for blocks, thing in zip(shown, meshes, strict=True):
            blocks.append(positions(thing, depsgraph))

    described, floats = [], 0
    with Path(f"{base}.bin").open("wb") as binary:
        for blocks, thing in zip(shown, meshes, strict=True):
            described.append(
                {
                    "name": thing.name,
                    "node": thing["node"],
                    "primitive": None,
                    "count": len(blocks[0]),
                    "positions": floats,
                    "shape_keys": describe_keys(thing),
                }
            )
            for block in blocks:
                binary.write(block.tobytes())
                floats += block.size
    report = {
        "times": (frames / fps).tolist(),
        "meshes": described,
        "version": bpy.app.version_string,
        "fps": scene.render.fps / scene.render.fps_base,
        "actions": {action.name: {"frames": list(action.frame_range)} for action in bpy.data.actions},
        "animated": moved,
    }
    Path(f"{base}.json").write_text(json.dumps(report), encoding="utf-8")


main()
