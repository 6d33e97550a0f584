"""Controls evaluated in C#, against the vertices that the service has."""

import numpy as np

from engine_bridge.service.protocol.header import Kind

from .conftest import array


def test_a_voice_moves_the_rest_pose_of_the_mouth(run_core, spoken, spoken_files):
    scene, *files = spoken_files(Kind.CONTROLS)
    slack = 2e-6 * spoken[0].character.prepared.mesh.diagonal
    for frame, file in zip(spoken, files, strict=True):
        evaluated, *_ = run_core("evaluate", scene, file)
        positions, normals = np.split(array(evaluated["vertices"], columns=6), 2, axis=1)
        where, turned = frame.vertices_and_normals
        assert np.abs(positions - where).max() <= slack
        assert np.abs(normals - turned).max() <= 1e-4
        assert (np.float32(evaluated["around"][:3]) <= where.min(axis=0) + slack).all()
        assert (np.float32(evaluated["around"][3:]) >= where.max(axis=0) - slack).all()
