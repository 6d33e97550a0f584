"""Blender's automatic weights (bone heat) for meshes and bones in files; runs in the environment of Blender's module.

    .venv-blender/bin/python benchmarks/bone_heat.py INPUT.npz OUTPUT.npz

The input has `vertices` (n, 3), `triangles` (t, 3), `heads` and `tails` (b, 3) and `parents` (b,). The output has
`weights` (n, b), as Blender has them, and `seconds`.
"""

import sys
import time

import bpy
import numpy as np


def main(source: str, output: str) -> None:
    """Read a mesh and bones, and write the weights."""
    with np.load(source) as file:
        data = {name: file[name] for name in file.files}
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("mesh")
    mesh.from_pydata(data["vertices"].tolist(), [], data["triangles"].tolist())
    body = bpy.data.objects.new("mesh", mesh)
    armature = bpy.data.objects.new("armature", bpy.data.armatures.new("armature"))
    for each in (body, armature):
        bpy.context.scene.collection.objects.link(each)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bones = []
    for number, (head, tail, parent) in enumerate(zip(data["heads"], data["tails"], data["parents"], strict=True)):
        bone = armature.data.edit_bones.new(f"bone_{number}")
        bone.head, bone.tail = head.tolist(), tail.tolist()
        bone.parent = bones[parent] if parent >= 0 else None
        bones.append(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
    body.select_set(True)
    armature.select_set(True)
    start = time.perf_counter()
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    seconds = time.perf_counter() - start
    weights = np.zeros((len(mesh.vertices), len(data["heads"])))
    numbers = [int(group.name.removeprefix("bone_")) for group in body.vertex_groups]
    for vertex in mesh.vertices:
        for group in vertex.groups:
            weights[vertex.index, numbers[group.group]] = group.weight
    np.savez(output, weights=weights, seconds=seconds)


if __name__ == "__main__":
    main(*sys.argv[1:])
