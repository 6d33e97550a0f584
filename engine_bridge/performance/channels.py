"""Channels of a performance: from the sound beside a take, to limbs that bend and morph targets that move."""

import wave
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.events import Cue
from capture.skeleton import LOST, swap_sides
from capture.sound import read_wav
from capture.timeline import Timeline
from capture.voice import voice_of
from engine_bridge.performance.pose import TargetPose
from engine_bridge.puppet.puppet import Puppet
from solver.model.bones import Bones
from solver.motion.limbs import TRUNK, bone_ranges


def with_voice(timeline: Timeline, clip: SkeletonClip, log: Path) -> tuple[Timeline, tuple[str, ...]]:
    """Take the channel ``voice`` from the sound that was recorded beside a take, and return notes about the sound.

    If the sound cannot be read, the channel is the one that was recorded in the take.

    Parameters
    ----------
    timeline : Timeline
    clip : SkeletonClip
        The clip that it was made of.
    log : Path
        The take.
    """
    sound = sound_of(clip, log)
    if sound is None:
        return timeline, ()
    path, begin = sound
    try:
        samples, rate = read_wav(path)
    except (OSError, EOFError, wave.Error) as error:
        why = getattr(error, "strerror", None) or error
        mouths = "stay closed" if "voice" not in (timeline.channels or {}) else "move as they did in the recording"
        return timeline, (f"The sound of the take, {path}, cannot be read ({why}). It is silent; mouths {mouths}.",)
    voice = voice_of(samples, rate, timeline.times - begin)
    return replace(timeline, channels={**(timeline.channels or {}), "voice": voice}), ()


def sound_of(clip: SkeletonClip, log: Path) -> tuple[Path, float] | None:
    """Return the sound that was recorded beside a take, according to its cue.

    Returns
    -------
    path : Path
    begin : float
        Time of its first sample after the clip's first frame with a known joint, in seconds.
    """
    first = float(clip.times[(clip.confidence > LOST).any(axis=1)][0])
    for cue in clip.cues:
        if cue.do == "sound" and (sound := sound_cue(cue)) is not None:
            return log.parent / sound[0], sound[1] - first
    return None


def sound_cue(cue: Cue) -> tuple[str, float] | None:
    """Return the name of the file in a cue ``sound`` and the time of its first sample; None if the cue is damaged."""
    file, begin = cue.arguments.get("file"), cue.arguments.get("at")
    return (Path(file).name, float(begin)) if isinstance(file, str) and isinstance(begin, int | float) else None


Channels = Mapping[str, float] | None
"""Values of a performer's channels in a frame by name; None without any."""


def sided(channels: Channels, mirror: bool) -> Channels:
    """Return the performer's channels as the character has them: of the other side if it mirrors the performer."""
    return {swap_sides(name): value for name, value in channels.items()} if channels and mirror else channels


def ranged(puppet: Puppet, channels: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values or arrays of channels, those with a table ``[[channel]]`` within its range, from 0 to 1."""
    scaled = {
        each.name: np.clip((channels[each.name] - each.neutral) / (each.full - each.neutral), 0, 1)
        for each in puppet.channel
        if each.name in channels
    }
    return {**channels, **scaled}


class ChannelMotion:
    """Limbs that channels bend, such as a jaw that opens with the voice, and handles that channels move.

    Parameters
    ----------
    puppet : Puppet
    bones : Bones
        Of its limbs.
    """

    def __init__(self, puppet: Puppet, bones: Bones) -> None:
        self._puppet = puppet
        self._bends: list[tuple[str, NDArray[np.float64], NDArray[np.float64], list[int]]] = []
        self._handles = [
            (number, each.channel, each.moves) for number, each in enumerate(puppet.handle) if each.channel
        ]
        ranges = bone_ranges(puppet.limbs)
        self._trunk = ranges[TRUNK].start if TRUNK in ranges else None
        for limb in sorted(puppet.limb, key=lambda limb: ranges[limb.name].start):
            if limb.bend is not None:
                first = ranges[limb.name].start
                moved = [first]
                moved += [bone for bone in range(first + 1, len(bones)) if _hangs_on(bones, bone, first)]
                self._bends.append((limb.bend.channel, limb.bend.turn, bones.heads[first], moved))

    def moved(self, pose: TargetPose, channels: Channels) -> TargetPose:
        """Return a pose with all bends and moved handles.

        Bones that hang on a bent one move with it. Handles move along axes that turn with the trunk.
        """
        if not channels or not (self._bends or self._handles):
            return pose
        channels = ranged(self._puppet, channels)
        return TargetPose(self._targets(pose, channels), self._motions(pose.bones, channels), pose.root)

    def _targets(self, pose: TargetPose, channels: Mapping[str, float]) -> NDArray[np.float64]:
        targets = pose.targets.copy()
        for number, channel, way in self._handles:
            move = channels.get(channel, 0.0) * np.array(way)
            targets[number] += move if self._trunk is None else move @ pose.bones[self._trunk, :3]
        return targets

    def _motions(self, motions: NDArray[np.float64], channels: Mapping[str, float]) -> NDArray[np.float64]:
        motions = motions.copy()
        for channel, turn, head, moved in self._bends:
            value = channels.get(channel, 0.0)
            if not value:
                continue
            around = np.eye(4)
            around[:3, :3] = scipy.spatial.transform.Rotation.from_rotvec(value * turn).as_matrix().T  # for row vectors
            around[3, :3] = head - head @ around[:3, :3]
            carried = _square(motions[moved[0]])
            change = np.linalg.inv(carried) @ around @ carried
            motions[moved] = [(_square(motions[bone]) @ change)[:, :3] for bone in moved]
        return motions


def _hangs_on(bones: Bones, bone: int, base: int) -> bool:
    """Return whether a bone is below another one in the tree of bones."""
    while bone > base:
        bone = int(bones.parents[bone])
    return bone == base


def _square(motion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a motion (4, 3) as a matrix (4, 4)."""
    return np.column_stack([motion, [0, 0, 0, 1]])


def morph_weights(puppet: Puppet, channels: Mapping[str, NDArray[np.float32]] | None) -> dict[str, NDArray[np.float32]]:
    """Return the weights (T,) of the morph targets that channels move, within [0, 1], by target."""
    weights: dict[str, NDArray[np.float32]] = {}
    values = ranged(puppet, channels or {})
    for morph in puppet.morph:
        if morph.channel in values:
            moved = np.float32(morph.gain) * values[morph.channel]
            weights[morph.target] = np.clip(weights.get(morph.target, 0) + moved, 0, 1)
    return weights


def weights_at(puppet: Puppet, channels: Mapping[str, float] | None) -> NDArray[np.float32]:
    """Return the weights (k,) at one moment of the targets in `Puppet.targets`."""
    values = {name: np.array([value], np.float32) for name, value in (channels or {}).items()}
    weights = morph_weights(puppet, values)
    return np.array([weights[target][0] if target in weights else 0.0 for target in puppet.targets], np.float32)
