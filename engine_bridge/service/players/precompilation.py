"""Compilation of everything that a frame of a character runs, before the first frame."""

import numpy as np

from capture.skeleton import JOINTS, TRACKED
from capture.smoothing import JointFilter
from engine_bridge.performance.easing import MAX_STEP_SECONDS, Easing, TargetPose
from engine_bridge.performance.retargeting import PERFORMER, legs_of
from engine_bridge.puppet.puppet import Puppet
from solver.motion.deformer import Deformer
from solver.motion.feet import Feet
from solver.motion.limb_motion import LimbMotion
from solver.motion.retarget import SmoothReturn, soft_limit


def precompile(puppet: Puppet, deformer: Deformer, rest: TargetPose) -> None:
    """Compile what a frame of a character runs, which takes 15 seconds the first time.

    Parameters
    ----------
    puppet : Puppet
    deformer : Deformer
        The character's; it is reset.
    rest : TargetPose
        The character's rest pose.
    """
    unknown, lost = np.full((len(JOINTS), 3), np.nan), np.zeros(len(JOINTS), dtype=np.float32)
    JointFilter(puppet.smoothing.parameters).step(0.0, np.zeros_like(unknown), np.full_like(lost, TRACKED))
    SmoothReturn(1).step(0.0, np.zeros((1, 3)), np.ones(1, dtype=bool))
    soft_limit(np.zeros((1, 3)), np.ones((1, 3, 2)))
    motions = LimbMotion(puppet.limbs, PERFORMER, unknown).step(0.0, unknown, lost)
    if legs := legs_of(puppet):
        Feet(deformer.bones, legs, 1.0).step(0.0, unknown, lost, motions, np.zeros(3))
    easing = Easing(deformer.bones, rest, 1.0)
    easing.begin(0.0)
    easing.show(MAX_STEP_SECONDS, rest)
    deformer.solve(deformer.handles)
    deformer.reset()
