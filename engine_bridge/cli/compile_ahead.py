"""Processes that compile, while a command that found nothing compiled is still reading and preparing.

Numba compiles one function at a time in a process, and a command finds out one after the other which ones it needs.
Those of a deformation, of a performer's motion and of pictures come late and do not need a character. All processes
keep what they have compiled on disk, and none compiles what another one is compiling (`puppetline.compiled`).
Until a performer's motion is compiled, Python computes it.
"""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from puppetline.child_process import bound_to_parent, end_with_parent
from puppetline.compiling import others, when_begun
from puppetline.interrupts import OWN_GROUP

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@contextmanager
def compiling_ahead(at_once: bool = False) -> Iterator[None]:
    """Start the processes when a function must be compiled, unless all is compiled already; end them at last.

    Parameters
    ----------
    at_once : bool
        Start them now, because other processes will need what they compile; they find out whether anything is left.
    """
    started: list[tuple[subprocess.Popen[bytes], threading.Thread]] = []

    def start() -> None:
        for name in WORK if (os.cpu_count() or 1) > 1 else ():
            command = [sys.executable, "-m", __name__, name]
            none = subprocess.DEVNULL
            process = subprocess.Popen(command, stdout=none, stderr=none, **bound_to_parent(), **OWN_GROUP)  # noqa: S603
            waiter = threading.Thread(target=process.wait, daemon=True)  # or it would stay, ended, beside a service
            waiter.start()
            started.append((process, waiter))
            others.append(process)

    def start_if_needed() -> None:
        if not is_done():
            start()

    if at_once:
        when_begun.clear()  # the command around this one would start others
        start()
    else:
        when_begun.append(start_if_needed)
    try:
        yield
    finally:
        if start_if_needed in when_begun:
            when_begun.remove(start_if_needed)
        for process, waiter in started:
            others.remove(process)
            process.kill()
            waiter.join()


def is_done() -> bool:
    """Return whether all that the processes compile is compiled."""
    from engine_bridge.pictures.drawing import paint
    from puppetline.compiled import is_compiled
    from solver.motion.arms import _step

    return is_compiled(_step.compiled) and is_compiled(paint)  # the last of each


def compile_ahead(name: str) -> None:
    """Compile a part of what commands need late, see `WORK`. Only types of arguments matter, so any figure will do."""
    for function in WORK[name]:
        function()


def _compile_deformation() -> None:
    """Compile what tells the surface of each bone and orders its vertices, and what moves it in a frame and a clip."""
    import numpy as np
    import scipy

    from solver.model.batch import BatchBinding
    from solver.model.bones import bone_regions
    from solver.model.kernels import blend_positions
    from solver.model.reduced_model import ReducedModel
    from solver.model.stretch import EdgeStretch
    from solver.motion.deformer import Deformer
    from solver.motion.limbs import Limb, bones_of
    from solver.skinning.weights import fit
    from solver.surface.dissection import nested_dissection
    from solver.surface.mesh import weld

    mesh = weld(*_tetrahedron())
    bones = bones_of([Limb("trunk", np.outer([0.1, 0.2, 0.3], np.ones(3)), ((0,), (1,), (2,)))])
    regions = bone_regions(mesh, bones)
    matrix = scipy.sparse.csr_matrix(np.eye(4))
    nested_dissection(matrix.indptr, matrix.indices, np.zeros((4, 3)))
    count = len(mesh.vertices)
    shares = np.full((count, len(bones)), 1 / len(bones))
    coordinates = np.linspace(0, 1, count, dtype=np.float32)[:, None]
    model = ReducedModel(  # of one field with two isolines
        center=np.zeros(3),
        diagonal=np.ones(()),
        weights=np.ones(1),
        isoline_coordinates=coordinates,
        A=np.eye(8),
        B=np.eye(8, 6),
        gram=np.eye(8),
        null_space=np.zeros((8, 8)),
        covariance=np.eye(6, 8),
        cluster=np.zeros(count, dtype=np.int32),
        A_clusters=np.eye(8),
        B_clusters=np.eye(8, 3),
        bones=bones,
        regions=regions,
        shares=shares.astype(np.float32),
    )
    motions = np.tile(np.eye(4, 3), (len(bones.parents), 1, 1))
    Deformer(model, mesh, np.zeros((0, 3))).solve(np.zeros((0, 3)), motions)
    controls = model.rest_controls[None]
    fit(model, mesh, controls, motions[None])
    EdgeStretch(mesh).add(BatchBinding.of_solver_mesh(model, mesh).displacements(controls))
    moved = mesh.vertices.astype(np.float32)
    transforms = np.zeros((2, 3, 4), dtype=np.float32)
    blend_positions(moved, coordinates, transforms, np.ones(1), np.zeros((2, 16), dtype=np.float32), moved.copy())


def _tetrahedron() -> "tuple[NDArray[np.float64], NDArray[np.int64]]":
    """Return the corners (4, 3) and the triangles (4, 3) of a tetrahedron."""
    import numpy as np

    return np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def _compile_pictures() -> None:
    """Compile what draws a surface."""
    from engine_bridge.pictures.mesh_picture import render
    from engine_bridge.pictures.view import View

    corners, faces = _tetrahedron()
    render(corners, faces, View.around(corners), (8, 8))


def _compile_motion() -> None:
    """Compile what makes a frame of a performer's motion: all functions that do not wait until they are compiled."""
    import numpy as np

    from capture.smoothing import JointFilter, Smoothing
    from engine_bridge.performance.retargeting import PERFORMER
    from engine_bridge.rigging.joints import Joint
    from engine_bridge.rigging.skeleton import Skeleton
    from solver.motion import motion_blend
    from solver.motion.arms import Arm, Arms
    from solver.motion.feet import Feet, Leg
    from solver.motion.floor import Floor
    from solver.motion.late_limbs import LateLimbs
    from solver.motion.limb_motion import LimbMotion
    from solver.motion.limbs import Limb
    from solver.motion.retarget import SmoothReturn, soft_limit
    from solver.motion.step_plan import PerformersLegs, StandingLeg
    from solver.motion.steps import Steps

    count = len(PERFORMER.opposite)
    joints, seen = np.random.default_rng(0).normal(size=(count, 3)), np.ones(count, dtype=np.float32)
    limbs = [Limb(str(k), joints[k : k + 4], tuple((j,) for j in range(k, k + 4)), "turn", delay=1.0) for k in (0, 4)]
    motion = LimbMotion(limbs, PERFORMER, joints)
    bones, motions, root = motion.bones, motion.step(0.0, joints, seen), np.zeros(3)
    JointFilter(Smoothing()).step(0.0, joints, seen)
    SmoothReturn(count).step(0.0, joints, seen > 0)
    soft_limit(joints, np.ones((count, 3, 2)))
    Feet(bones, [Leg(0, 1, 2, 3), Leg(3, 4, 5, 7)], 1.0).step(0.0, joints, seen, motions, root)
    joint = Joint("hips", -1, 0, np.zeros(3), np.ones(3))
    Skeleton((joint,), np.eye(3)[None], np.eye(3), np.zeros(3)).pose(motions, root)
    motion_blend.moved_by(bones, motions, motion_blend.difference(bones, motions, motions), 0.5)
    Floor(limbs, bones, joints, np.zeros(count, dtype=np.int64), np.eye(3)).step(motions, root)
    LateLimbs(limbs, bones).step(0.0, motions, root)
    legs = PerformersLegs((0, 1), (2, 3), 1.0, 1.0)
    Steps(bones, [StandingLeg((0, 1, 2), 3, 4)], (), legs, 1.0).step(0.0, joints, seen, motions, root)
    Arms(bones, Arm(0, 1, 2, 3), Arm(3, 4, 5, 7), 1.0).step(0.0, joints, seen, motions)


WORK = {"motion": (_compile_deformation, _compile_motion), "pictures": (_compile_pictures,)}
"""What each process compiles."""


if __name__ == "__main__":
    end_with_parent()
    if not is_done():
        compile_ahead(sys.argv[1])
