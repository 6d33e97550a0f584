"""A second process that compiles, while a command that found nothing compiled is still reading and preparing.

Numba compiles one function at a time in a process, and a command finds out one after the other which ones it needs.
Those of a performer's motion and of pictures come late, do not need a character, and take about half of the time. Both
processes keep what they have compiled on disk, and neither compiles what the other one is compiling
(`puppetline.compiled`).
"""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from puppetline.compiling import when_begun
from puppetline.interrupts import OWN_GROUP


@contextmanager
def second_process(at_once: bool = False) -> Iterator[None]:
    """Start the second process when a function must be compiled, unless it has done its work before; end it at last.

    Parameters
    ----------
    at_once : bool
        Start it now, because other processes will need what it compiles; it finds out itself whether anything is left.
    """
    started: list[tuple[subprocess.Popen[bytes], threading.Thread]] = []

    def start() -> None:
        if (os.cpu_count() or 1) > 1:
            command = [sys.executable, "-m", __name__]
            none = subprocess.DEVNULL
            process = subprocess.Popen(command, stdin=none, stdout=none, stderr=none, **OWN_GROUP)  # noqa: S603
            waiter = threading.Thread(target=process.wait, daemon=True)  # or it would stay, ended, beside a service
            waiter.start()
            started.append((process, waiter))

    def start_if_needed() -> None:
        if not is_done():
            start()

    if at_once:
        when_begun.clear()  # the command around this one would start another
        start()
    else:
        when_begun.append(start_if_needed)
    try:
        yield
    finally:
        if start_if_needed in when_begun:
            when_begun.remove(start_if_needed)
        for process, waiter in started:
            process.kill()
            waiter.join()


def is_done() -> bool:
    """Return whether the second process has done its work before."""
    from engine_bridge.pictures.rasteriser import rasterise  # one of the last that it compiles
    from puppetline.compiled import is_compiled

    return is_compiled(rasterise)


def compile_ahead() -> None:
    """Compile what commands need late, in that order. Only types of arguments matter, so any figure will do."""
    _compile_motion()
    _compile_surface()


def _compile_motion() -> None:
    """Compile what makes a frame of a performer's motion."""
    import numpy as np

    from capture.smoothing import JointFilter, Smoothing
    from engine_bridge.performance.retargeting import PERFORMER
    from solver.motion.arms import Arm, Arms
    from solver.motion.feet import Feet, Leg
    from solver.motion.limb_motion import LimbMotion
    from solver.motion.limbs import Limb
    from solver.motion.retarget import SmoothReturn, soft_limit

    count = len(PERFORMER.opposite)
    joints, seen = np.random.default_rng(0).normal(size=(count, 3)), np.ones(count, dtype=np.float32)
    limbs = [Limb(str(k), joints[k : k + 4], tuple((j,) for j in range(k, k + 4))) for k in (0, 4)]
    motion = LimbMotion(limbs, PERFORMER, joints)
    motions, root = motion.step(0.0, joints, seen), np.zeros(3)
    JointFilter(Smoothing()).step(0.0, joints, seen)
    SmoothReturn(count).step(0.0, joints, seen > 0)
    Feet(motion.bones, [Leg(0, 1, 2, 3), Leg(3, 4, 5, 7)], 1.0).step(0.0, joints, seen, motions, root)
    Arms(motion.bones, Arm(0, 1, 2, 3), Arm(3, 4, 5, 7), 1.0).step(0.0, joints, seen, motions)
    soft_limit(joints, np.ones((count, 3, 2)))


def _compile_surface() -> None:
    """Compile what computes, measures and draws a frame's surface."""
    import numpy as np

    from engine_bridge.pictures.renderer import View, render
    from solver.model.kernels import blend_positions
    from solver.model.polar import of_matrices
    from solver.model.stretch import EdgeStretch
    from solver.surface.mesh import weld

    of_matrices(np.eye(3)[None])
    corners = np.vstack([np.zeros(3), np.eye(3)])
    mesh = weld(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    moved = mesh.vertices.astype(np.float32)
    EdgeStretch(mesh).add(np.stack([moved, moved], axis=-1))
    coordinates, controls = np.zeros((len(moved), 1), dtype=np.float32), np.zeros((2, 3, 4), dtype=np.float32)
    blend_positions(moved, coordinates, controls, np.ones(1), np.zeros((2, 16), dtype=np.float32), moved.copy())
    render(mesh.vertices, mesh.faces, View.around(mesh.vertices), (8, 8))


if __name__ == "__main__":
    if not is_done():
        compile_ahead()
