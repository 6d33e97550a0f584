"""A character of a film: what it plays at each frame, with cross-fades, and where it stands."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.scene import CharacterTable
from engine_bridge.film.takes import Footing, Place, Segment
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.grounding import stands
from engine_bridge.performance.motion import SolvedMotion
from engine_bridge.performance.pose import Pose, between, difference_of, smoothstep
from engine_bridge.performance.prepared_character import PreparedCharacter

SETTLING_STEPS = 12
"""Number of times that the first frame of a cross-fade is solved, because the solver starts from the rest pose."""


class Actor:
    """A character of a film with its motion.

    Parameters
    ----------
    table : CharacterTable
    home : Place
        Where it stands without a take.
    prepared : PreparedCharacter
    footing : Footing
    segments : sequence of Segment
        In the order of their beginnings.

    Attributes
    ----------
    name : str
    color : str or None
        By which its own colours are multiplied.
    prepared : PreparedCharacter
    footing : Footing
    """

    def __init__(
        self,
        table: CharacterTable,
        home: Place,
        prepared: PreparedCharacter,
        footing: Footing,
        segments: Sequence[Segment],
    ) -> None:
        self.name, self.color, self.home, self.prepared, self.footing = table.name, table.color, home, prepared, footing
        self.segments = segments
        self._begins = np.array([segment.begin for segment in segments])
        self._motion = CharacterMotion(prepared)
        rest, R = self._motion.at_rest, prepared.model.rest_controls.astype(np.float32)
        self._at_rest = Pose(rest.targets, rest.bones, rest.root, R, prepared.model)
        self._fades = {
            number: self._faded(segments[number - 1], segments[number])
            for number in range(1, len(segments))
            if segments[number].fade
        }

    @property
    def stands(self) -> bool:
        """Whether its feet are held on the floor."""
        return stands(self.prepared.puppet)

    def _number_at(self, frame: int) -> int:
        """Return the number of the segment that is played at a frame, with its cross-fade; −1 without any segment."""
        return max(int(np.searchsorted(self._begins, frame, side="right")) - 1, 0) if self.segments else -1

    def pose(self, frame: int) -> Pose:
        """Return the pose at a frame of the film."""
        number = self._number_at(frame)
        if number < 0:
            return self._at_rest
        segment, fade = self.segments[number], self._fades.get(number)
        into = frame - segment.begin
        return segment.pose(frame) if fade is None or into >= segment.fade else fade[into]

    def place(self, frame: int) -> Place:
        """Return where the character stands at a frame of the film."""
        number = self._number_at(frame)
        if number < 0:
            return self.home
        segment = self.segments[number]
        into = frame - segment.begin
        if number == 0 or into >= segment.fade:
            return segment.place
        before, share = self.segments[number - 1].place, smoothstep((into + 1) / (segment.fade + 1))
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
        return np.vstack([linear, place.position - self.footing.lift + self.pose(frame).root @ linear])

    def _faded(self, before: Segment, after: Segment) -> SolvedMotion:
        """Solve the frames of a cross-fade, in which each bone turns the shortest way relative to its parent."""
        bones, fade, apart = self.prepared.model.bones, SolvedMotion(self.prepared, after.motion.fps), None
        for k in range(after.fade):
            start, end = before.pose(after.begin + k), after.pose(after.begin + k)
            apart = difference_of(bones, end, start) if apart is None else apart
            target = between(bones, start, end, smoothstep((k + 1) / (after.fade + 1)), apart)
            for _ in range(SETTLING_STEPS if k == 0 else 1):
                pose = self._motion.solve(target)
            fade.append(replace(pose, channels=end.channels))
        return fade
