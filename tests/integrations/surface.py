"""What a character's surface does in some frames, computed with NumPy and the project's solver."""

import numpy as np

from engine_bridge.performance.clip import load_timeline, solve
from engine_bridge.performance.rig import load_rig
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units


def vertices_of(take, puppet, settings):
    """Return the vertices (F, N, 3) of all frames, and the diagonal."""
    rig = load_rig(puppet)
    timeline, _ = load_timeline(take, settings)
    (frames,) = solve(rig, timeline, settings, 1000)
    binding = Binding(rig.model, rig.character.vertices, rig.mesh.of_render)
    vertices = [
        binding.vertices(to_file_units(R, rig.model)) + root for R, root in zip(frames.R, frames.root, strict=True)
    ]
    return np.array(vertices), rig.mesh.diagonal


def affine(rest, positions, point):
    """Return where the least-squares affine map of the vertices around a point takes it and the three axes."""
    distance = np.linalg.norm(rest - point, axis=1)
    near = np.flatnonzero(distance <= 1.4 * distance.min())
    near = near[(np.arange(min(len(near), 32)) * max(1.0, len(near) / 32)).astype(int)]
    design = np.hstack([rest[near] - point, np.ones((len(near), 1))])
    return np.linalg.lstsq(design, positions[near], rcond=None)[0]


def outward(positions, triangles, vertex):
    """Return the area-weighted normal of the triangles at a vertex."""
    corners = positions[triangles[(triangles == vertex).any(axis=1)]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    return normal / np.linalg.norm(normal)
