"""Objects attached to a character, with stand-ins for Unity: compared with all vertices in the same frames."""

import numpy as np
import pytest

from ..surface import affine, outward
from .conftest import performed, shown

UNITY = np.float32([-1, 1, 1])


def world(said, theirs):
    """Return the space of the character as rows, and the vertices in the world."""
    space = np.reshape(said["space"], (4, 3))
    return space, (theirs.positions * UNITY) @ space[:3] + space[3]


@pytest.mark.parametrize(("mode", "scale"), [("Controls", None), ("Vertices", "-1.5,0.5,3"), ("Vertices16", "2,2,1")])
def test_an_object_lies_on_its_vertex_and_turns_with_the_surface(show, stage, blob_rig, mode, scale):
    count = len(blob_rig.character.vertices)
    chosen = [0, count // 3, count // 2, count - 1]
    fields = {"materials": "Any/Shader", "mode": mode, "attach": ",".join(f"vertex:{each}" for each in chosen)}
    program = show(**fields, **({} if scale is None else {"scale": scale}))
    side = 1 if scale == "-1.5,0.5,3" else -1  # in Unity, triangles turn over; this space is mirrored
    poses = []
    for said, theirs in shown(program, stage):
        space, vertices = world(said, theirs)
        tolerance = (1e-4 if mode == "Vertices16" else 1e-5) * blob_rig.mesh.diagonal * np.abs(space[:3]).max()
        for vertex, attached in zip(chosen, said["attached"], strict=True):
            pose = np.reshape(attached, (4, 3))
            np.testing.assert_allclose(pose[:3] @ pose[:3].T, np.eye(3), atol=1e-5)
            assert np.linalg.det(pose[:3]) == pytest.approx(1, abs=1e-5)
            assert np.abs(pose[3] - vertices[vertex]).max() <= tolerance
            assert side * pose[1] @ outward(vertices, blob_rig.character.triangles, vertex) > 0.97
        poses.append(said["attached"])
    assert np.ptp(poses, axis=0)[:, :9].max() > 0.05
    program.finish()


def test_a_handle_is_at_the_vertex_nearest_to_it(show, stage, blob_rig):
    handle = blob_rig.puppet.handle[0]
    vertex = np.linalg.norm(blob_rig.character.vertices - np.array(handle.position), axis=1).argmin()
    program = show(materials="Any/Shader", attach=f"handle:{handle.name},vertex:{vertex}")
    for said, _ in shown(program, stage):
        np.testing.assert_array_equal(*said["attached"])
    program.finish()


def test_a_point_that_is_not_there_is_warned_of_once(show, stage):
    program = show(materials="Any/Shader", attach="handle:no such handle")
    shown(program, stage, 2)
    assert sum("warning" in said for said in program.finish()) == 1


def test_a_limb_carries_the_affine_mean_of_the_vertices_around_its_point(show, new_stage, limbed_puppet, take):
    stage = new_stage(performed(limbed_puppet, take))
    limbed_rig = stage.character.rig
    rest = limbed_rig.character.vertices
    limb = next(each for each in limbed_rig.puppet.limb if each.name == "left arm")
    start, end = np.array(limb.points[0]), np.array(limb.points[-1])
    point = (start + end) / 2
    fields = {"character": limbed_puppet.stem, "materials": "Any/Shader", "attach": "limb:left arm:0.5"}
    program = show(stage, **fields)
    for said, theirs in shown(program, stage):
        [attached] = said["attached"]
        pose = np.reshape(attached, (4, 3)) * UNITY
        along_x, along_y, along_z, expected = affine(rest, theirs.positions, point)
        assert np.abs(pose[3] - expected).max() <= 1e-4 * limbed_rig.mesh.diagonal
        direction = (end - start) @ [along_x, along_y, along_z]
        assert pose[1] @ direction / np.linalg.norm(direction) > 0.9
    program.finish()
