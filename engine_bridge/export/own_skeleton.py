"""Whether the skeleton in a character's file can move the puppet's limbs, measured on the file that it would give."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from engine_bridge.character.evaluation import Evaluation
from engine_bridge.export.animation import Keyframes
from engine_bridge.export.rig_animation import animate_rig
from engine_bridge.performance.exercise import random_poses
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.puppet.rig_bones import RigBones, nearest_bones, own_bones
from puppetline.errors import MeshError
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units
from solver.motion.limbs import bone_ranges, bones_of

POSES = 24
"""Number of random poses in which the file is compared with the solver's surface."""

MAX_MISSED_SHARE = 0.8
"""Largest distance between a limb in the file and in the solved surface, as a share of the limb's own motion. Of 21
public characters, limbs that a skeleton moves have at most 0.39, with very coarse models 0.7; limbs that it leaves
still have 1."""

MIN_MOTION = 0.01
"""Smallest motion of a limb by which it is judged, as a fraction of the diagonal."""


@dataclass(frozen=True)
class OwnSkeleton:
    """The skeleton in a character's file.

    Attributes
    ----------
    bones : RigBones or None
        Bones that its joints follow; None if the file has no skeleton along the puppet's limbs.
    unmoved : tuple of str
        Names of limbs that the skeleton cannot move as they are solved, and of all handles that move.
    because : str
        What is wrong with the skeleton, where that is known.
    """

    bones: RigBones | None
    unmoved: tuple[str, ...] = ()
    because: str = ""

    @property
    def usable(self) -> RigBones | None:
        """The bones, or None if there are none or a limb would not move."""
        return None if self.unmoved else self.bones

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the user about limbs that would not move."""
        if not self.unmoved:
            return ()
        return (
            f"The file's own skeleton would not move {', '.join(self.unmoved)} as the puppet does{self.because}. A new "
            "skeleton moves the whole character. To keep the file's own, remove these from the puppet file.",
        )


_FOUND: WeakKeyDictionary[PreparedCharacter, OwnSkeleton] = WeakKeyDictionary()
"""Skeletons that were judged, for the next clips of the same characters."""


def own_skeleton(prepared: PreparedCharacter) -> OwnSkeleton:
    """Judge the skeleton in a character's file by random poses of the puppet, once for each prepared character.

    The file is animated with the poses and evaluated. In each pose, the vertices nearest to a limb have a distance from
    where the solver has them, and from where they would be if the limb did not bend.
    """
    if prepared not in _FOUND:
        bones, mapping = own_bones(prepared.character, prepared.puppet), prepared.puppet.mapping
        moving = np.asarray(mapping.axes.any(axis=1) & mapping.matrix.any(axis=1))
        handles = tuple(handle.name for handle, moves in zip(prepared.puppet.handle, moving, strict=True) if moves)
        _FOUND[prepared] = OwnSkeleton(None) if bones is None else _judged(prepared, bones, handles)
    return _FOUND[prepared]


def _judged(prepared: PreparedCharacter, bones: RigBones, handles: tuple[str, ...]) -> OwnSkeleton:
    """Return a file's skeleton with what it would not move, and why; `handles` are the names of handles that move."""
    try:
        unmoved = _unmoved(prepared, bones)
    except MeshError as error:  # of a joint that cannot be animated
        return OwnSkeleton(bones, (*bone_ranges(prepared.puppet.limbs), *handles), f": it has {error.found}")
    missing = [name for name in unmoved if name in bones.missing]
    return OwnSkeleton(bones, unmoved + handles, f": no joint is along {', '.join(missing)}" if missing else "")


def _unmoved(prepared: PreparedCharacter, own: RigBones) -> tuple[str, ...]:
    """Return the names of the limbs whose root mean square distance is too large a share of their motion."""
    controls, motions = random_poses(prepared, POSES, handles=False)
    times = np.arange(POSES, dtype=np.float32)
    keyframes = Keyframes("poses", times, np.zeros((POSES, 0), np.float32), None)
    document, _ = animate_rig(prepared.character.document, keyframes, own, motions.astype(np.float32))
    binding = Binding.of_solver_mesh(prepared.model, prepared.mesh)
    bones, ranges = bones_of(prepared.puppet.limbs), bone_ranges(prepared.puppet.limbs)
    rest = prepared.character.vertices
    nearest = nearest_bones(rest, bones)
    of_limbs = {name: np.isin(nearest, numbers) for name, numbers in ranges.items()}
    missed, moved = dict.fromkeys(ranges, 0.0), dict.fromkeys(ranges, 0.0)
    for pose, shown in enumerate(Evaluation(document, prepared.character.parts).positions(times)):
        solved = binding.vertices(to_file_units(controls[pose], prepared.model))[prepared.mesh.of_render]
        for name, chosen in of_limbs.items():
            parent = bones.parents[ranges[name].start]
            held = rest[chosen]
            if parent >= 0:
                held = held @ motions[pose, parent, :3] + motions[pose, parent, 3]
            missed[name] += float(np.square(shown[chosen] - solved[chosen]).sum())
            moved[name] += float(np.square(solved[chosen] - held).sum())
    counts = {name: POSES * max(int(chosen.sum()), 1) for name, chosen in of_limbs.items()}
    least = (MIN_MOTION * float(prepared.model.diagonal)) ** 2
    return tuple(
        name
        for name in ranges
        if moved[name] >= least * counts[name] and missed[name] > MAX_MISSED_SHARE**2 * moved[name]
    )
