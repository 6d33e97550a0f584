"""Objects attached to a character, with stand-ins for Unity: compared with all vertices in the same frames."""

import numpy as np
import pytest

from ..stage import performed
from ..surface import assert_on_limb, assert_on_vertex
from .conftest import shown

UNITY = np.float32([-1, 1, 1])


def world(said, theirs):
    """Return the space of the character as rows, and the vertices in the world."""
    space = np.reshape(said["space"], (4, 3))
    return space, (theirs.positions * UNITY) @ space[:3] + space[3]


@pytest.mark.parametrize(("mode", "scale"), [("Controls", None), ("Vertices", "-1.5,0.5,3"), ("Vertices16", "2,2,1")])
def test_an_object_lies_on_its_vertex_and_turns_with_the_surface(show, stage, prepared_blob, mode, scale):
    count = len(prepared_blob.character.vertices)
    chosen = [0, count // 3, count // 2, count - 1]
    fields = {"materials": "Any/Shader", "mode": mode, "attach": ",".join(f"vertex:{each}" for each in chosen)}
    program = show(**fields, **({} if scale is None else {"scale": scale}))
    side = 1 if scale == "-1.5,0.5,3" else -1  # in Unity, triangles turn over; this space is mirrored
    poses = []
    for said, theirs in shown(program, stage):
        space, vertices = world(said, theirs)
        tolerance = (1e-4 if mode == "Vertices16" else 1e-5) * prepared_blob.mesh.diagonal * np.abs(space[:3]).max()
        for vertex, attached in zip(chosen, said["attached"], strict=True):
            pose = np.reshape(attached, (4, 3))
            assert_on_vertex(pose, vertices, prepared_blob.character.triangles, vertex, tolerance, side)
        poses.append(said["attached"])
    assert np.ptp(poses, axis=0)[:, :9].max() > 0.05
    program.finish()


def test_a_handle_is_at_the_vertex_nearest_to_it_and_one_that_is_not_there_is_warned_of_once(
    show, stage, prepared_blob
):
    handle = prepared_blob.puppet.handle[0]
    vertex = np.linalg.norm(prepared_blob.character.vertices - np.array(handle.position), axis=1).argmin()
    program = show(materials="Any/Shader", attach=f"handle:{handle.name},vertex:{vertex},handle:none")
    for said, _ in shown(program, stage):
        np.testing.assert_array_equal(*said["attached"][:2])
    assert sum("warning" in said for said in program.finish()) == 1


def test_a_limb_carries_the_affine_mean_of_the_vertices_around_its_point(show, new_stage, limbed_puppet, take):
    stage = new_stage(performed(limbed_puppet, take))
    prepared = stage.character.prepared
    limb = next(each for each in prepared.puppet.limb if each.name == "left arm")
    program = show(stage, character="limbed", materials="Any/Shader", attach="limb:left arm:0.5")
    for said, theirs in shown(program, stage):
        pose = np.reshape(said["attached"], (4, 3)) * UNITY
        assert_on_limb(pose, prepared.character.vertices, theirs.positions, limb, 0.5, 1e-4 * stage.diagonal)
    program.finish()
