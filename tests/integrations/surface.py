"""What a character's surface does in a frame, and where objects that are attached to it belong."""

import numpy as np


def blended(scene, controls):
    """Return the vertices' matrices (n, 3, 4) of docs/protocol.md, and how they change over an isoline (n, e, 3, 4)."""
    facts, t = scene.facts, scene.arrays["ladder"].astype(float)
    T = np.float64(controls).reshape(facts["fields"], facts["isolines"], 3, 4)
    k = np.minimum(t.astype(int), facts["isolines"] - 2)
    fields = np.arange(facts["fields"])
    steps = T[fields, k + 1] - T[fields, k]
    return np.einsum("i,vixy->vxy", facts["weights"], T[fields, k] + (t - k)[..., None, None] * steps), steps


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


def assert_rigid(pose):
    np.testing.assert_allclose(pose[:3] @ pose[:3].T, np.eye(3), atol=1e-5)
    assert abs(np.linalg.det(pose[:3]) - 1) <= 1e-5


def assert_on_vertex(pose, positions, triangles, vertex, tolerance, side=1):
    """Compare a pose, whose rows are its axes and its place; `side` is -1 where triangles are turned over."""
    assert_rigid(pose)
    assert np.abs(pose[3] - positions[vertex]).max() <= tolerance
    # the mean of a patch, so it differs from the normal of the vertex
    assert side * pose[1] @ outward(positions, triangles, vertex) > 0.97


def assert_on_limb(pose, rest, positions, limb, share, tolerance):
    start, end = np.array(limb.points[0]), np.array(limb.points[-1])
    along_x, along_y, along_z, expected = affine(rest, positions, start + share * (end - start))
    assert np.abs(pose[3] - expected).max() <= tolerance
    direction = (end - start) @ [along_x, along_y, along_z]
    assert pose[1] @ direction / np.linalg.norm(direction) > 0.9
