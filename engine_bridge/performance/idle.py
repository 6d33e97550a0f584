"""Idle recordings: motion of a character without a performer, in a seamless loop."""

from pathlib import Path

from engine_bridge.performance.clip import load_timeline, reference_pose
from engine_bridge.performance.motion import Motion
from engine_bridge.performance.pose import TargetPose, between
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.performance.settings import Settings
from solver.motion.deformer import Deformer

CROSSFADE_SECONDS = 0.5
"""Duration of the blend from the recording's end to its start, in seconds."""


def idle_motion(log: Path, prepared: PreparedCharacter, deformer: Deformer) -> Motion[TargetPose]:
    """Return the motion by a recording as a loop, not solved.

    Parameters
    ----------
    log : Path
        Recording in any format.
    prepared : PreparedCharacter
    deformer : Deformer
        Deformer of the character, which is not changed.

    Raises
    ------
    SkeletonLogError
    """
    settings = Settings()
    timeline, _ = load_timeline(log, settings)
    retargeting = Retargeting(
        prepared.puppet, prepared.mesh, deformer, reference_pose(prepared.puppet, timeline, settings)
    )
    poses = [retargeting.step(timeline.frame(number)) for number in range(len(timeline.positions))]
    # the end blends into the frames before the new start
    overlap = min(round(CROSSFADE_SECONDS * timeline.fps), len(poses) // 2)
    loop = poses[overlap:]
    for k, last in enumerate(range(len(loop) - overlap, len(loop))):
        loop[last] = between(prepared.model.bones, loop[last], poses[k], k / overlap)
    return Motion(prepared, timeline.fps, loop, loops=True)
