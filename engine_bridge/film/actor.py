"""A character of a film: what it plays at each frame, with cross-fades, and where it stands."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.scene import CharacterTable
from engine_bridge.film.takes import Footing, Motion, Place, Segment
from engine_bridge.performance.performance import make_deformer
from engine_bridge.performance.retargeting import legs_of
from engine_bridge.performance.rig import Rig
from solver.motion.motion_blend import difference, moved_by

SETTLING_STEPS = 12
"""Number of times that the first frame of a cross-fade is solved, because the solver starts from the rest pose."""


class Actor:
    """A character of a film with its motion.

    Parameters
    ----------
    table : CharacterTable
    rig : Rig
    footing : Footing
    segments : sequence of Segment
        In the order of their beginnings.

    Attributes
    ----------
    name : str
    rig : Rig
    footing : Footing
    """

    def __init__(self, table: CharacterTable, rig: Rig, footing: Footing, segments: Sequence[Segment]) -> None:
        self.name, self.rig, self.footing = table.name, rig, footing
        self.home = Place(np.array([table.position[0], 0.0, table.position[1]]), table.turn)
        self.segments = segments
        self._begins = np.array([segment.begin for segment in segments])
        self._deformer = make_deformer(rig.puppet, rig.mesh, rig.model)
        self._fades = {
            number: self._faded(segments[number - 1], segments[number])
            for number in range(1, len(segments))
            if segments[number].fade
        }

    @property
    def stands(self) -> bool:
        """Whether its feet are held on the floor."""
        puppet = self.rig.puppet
        return bool(legs_of(puppet)) or any(limb.stands for limb in puppet.limb)

    def _place_in(self, frame: int) -> tuple[Motion | None, int, int]:
        """Return what is played at a frame, the row in it, and the number of the segment; None for the rest pose."""
        if not len(self.segments):
            return None, 0, -1
        number = max(int(np.searchsorted(self._begins, frame, side="right")) - 1, 0)
        segment = self.segments[number]
        into = frame - segment.begin
        if number in self._fades and into < segment.fade:
            return self._fades[number], into, number
        return segment.motion, segment.row(frame), number

    def controls(self, frame: int) -> NDArray[np.float32]:
        """Return the control variables (4m, 3) at a frame of the film, model units."""
        motion, row, _ = self._place_in(frame)
        return self.rig.model.rest_controls.astype(np.float32) if motion is None else motion.R[row]

    def bones(self, frame: int) -> NDArray[np.float32]:
        """Return the motions of the bones (b, 4, 3) at a frame of the film."""
        motion, row, _ = self._place_in(frame)
        if motion is None:
            return np.tile(np.eye(4, 3, dtype=np.float32), (len(self._deformer.bones), 1, 1))
        return motion.motions[row]

    def root(self, frame: int) -> NDArray[np.float32]:
        """Return the root's translation (3,) at a frame of the film, mesh file's coordinates."""
        motion, row, _ = self._place_in(frame)
        return np.zeros(3, np.float32) if motion is None else motion.root[row]

    def channels(self, frame: int) -> dict[str, float]:
        """Return the values of the channels at a frame of the film."""
        motion, row, _ = self._place_in(frame)
        return {} if motion is None else {name: float(values[row]) for name, values in motion.channels.items()}

    def place(self, frame: int) -> Place:
        """Return where the character stands at a frame of the film."""
        _, _, number = self._place_in(frame)
        if number < 0:
            return self.home
        segment = self.segments[number]
        into = frame - segment.begin
        if number == 0 or into >= segment.fade:
            return segment.place
        before, share = self.segments[number - 1].place, eased((into + 1) / (segment.fade + 1))
        way = (segment.place.turn - before.turn + 180) % 360 - 180
        return Place(before.position + share * (segment.place.position - before.position), before.turn + share * way)

    @property
    def end(self) -> int:
        """Number of frames until the last take has ended."""
        return max((each.begin + each.end - each.first for each in self.segments), default=0)

    def to_stage(self, frame: int) -> NDArray[np.float64]:
        """Return the map (4, 3) of row vectors [x 1] from the mesh file's coordinates to the film's, with the root."""
        place = self.place(frame)
        linear = self.footing.linear(place.turn)
        lift = [0, self.footing.scale * self.footing.low, 0]
        return np.vstack([linear, place.position - lift + self.root(frame) @ linear])

    def _faded(self, before: Segment, after: Segment) -> Motion:
        """Solve the frames of a cross-fade, in which each bone turns the shortest way relative to its parent."""
        bones = self._deformer.bones
        made = Motion(self.rig, len(bones))
        apart = None
        for k in range(after.fade):
            old, new = before.row(after.begin + k), after.row(after.begin + k)
            share = eased((k + 1) / (after.fade + 1))
            was, becomes = (
                (each.motion.targets[row], each.motion.motions[row].astype(np.float64), each.motion.root[row])
                for each, row in ((before, old), (after, new))
            )
            # the whole way is measured once; measured in each frame, a bone could change its direction half way
            apart = difference(bones, becomes[1], was[1]) if apart is None and len(bones) else apart
            motions = becomes[1] if apart is None else moved_by(bones, becomes[1], apart, 1 - share)
            targets = was[0] + share * (becomes[0] - was[0])
            for _ in range(SETTLING_STEPS if k == 0 else 1):
                R = self._deformer.solve(targets, motions)
            made.append(R, targets, motions, was[2] + share * (becomes[2] - was[2]))
        made.channels = {
            name: np.array([after.motion.channels[name][after.row(after.begin + k)] for k in range(after.fade)])
            for name in after.motion.channels
        }
        return made


def eased(share: float) -> float:
    """Return a share of the way with a soft start and end (smoothstep)."""
    return share * share * (3 - 2 * share)
