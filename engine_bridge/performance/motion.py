"""Motion of a character over time, as poses at an even rate: of takes, clips, cross-fades and idle recordings."""

from collections.abc import Sequence
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from engine_bridge.performance.frame_store import FrameStore
from engine_bridge.performance.pose import P, Pose, between
from engine_bridge.performance.prepared_character import PreparedCharacter


class Motion(Generic[P]):
    """Poses of a character at an even rate, from second 0 on.

    Parameters
    ----------
    prepared : PreparedCharacter
    fps : float
    poses : sequence of TargetPose or Pose
    loops : bool, optional
        Whether the first pose follows the last one again, for ever; otherwise the ends hold.

    Attributes
    ----------
    prepared, fps
    """

    def __init__(
        self, prepared: PreparedCharacter, fps: float, poses: Sequence[P] = (), *, loops: bool = False
    ) -> None:
        self.prepared, self.fps = prepared, fps
        self._poses, self._loops = poses, loops

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self._poses)

    def __getitem__(self, number: int) -> P:
        """Return one of the poses."""
        return self._poses[number]

    def at(self, seconds: float) -> P:
        """Return the pose at a time, between the two nearest ones."""
        count, place = len(self), seconds * self.fps
        place = place % count if self._loops else min(max(place, 0.0), count - 1.0)
        before = int(place)
        start, end = (self[number % count] for number in (before, before + 1))
        return between(self.prepared.model.bones, start, end, place - before)


class SolvedMotion(Motion[Pose]):
    """Solved poses of a character at an even rate, which are kept in temporary files if they are many.

    Attributes
    ----------
    R, targets, bones, root : FrameStore
        (F, 4m, 3), (F, h, 3), (F, b, 4, 3) and (F, 3) float32, see `Pose`.
    """

    def __init__(self, prepared: PreparedCharacter, fps: float) -> None:
        super().__init__(prepared, fps)
        self.R = FrameStore(prepared.model.rest_controls.shape)
        self.targets = FrameStore((len(prepared.puppet.handle), 3))
        self.bones = FrameStore((len(prepared.model.bones), 4, 3))
        self.root = FrameStore((3,))
        self._columns: dict[str, int] = {}  # of the channels so far
        self._channels: list[NDArray[np.float32]] = []  # of each pose; NaN, or nothing at the end, where it has none

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.R)

    def __getitem__(self, number: int) -> Pose:
        """Return one of the poses."""
        return Pose(
            self.targets[number],
            self.bones[number],
            self.root[number],
            self.R[number],
            self.prepared.model,
            self._channels_at(number),
        )

    def append(self, pose: Pose) -> None:
        """Add the next pose.

        Raises
        ------
        OutputError
            No space is left for temporary files.
        """
        for name in ("R", "targets", "bones", "root"):
            getattr(self, name).append(getattr(pose, name)[None])
        values = pose.channels or {}
        for name in values:
            self._columns.setdefault(name, len(self._columns))
        self._channels.append(np.array([values.get(name, np.nan) for name in self._columns], np.float32))

    def _channels_at(self, number: int) -> dict[str, float]:
        values = zip(self._columns, self._channels[number].tolist(), strict=False)
        return {name: value for name, value in values if value == value}

    @property
    def times(self) -> NDArray[np.float64]:
        """Times (F,) of the poses in seconds."""
        return np.arange(len(self)) / self.fps

    @property
    def channels(self) -> dict[str, NDArray[np.float32]]:
        """Values (F,) of each channel, 0 where it has none."""
        values = np.zeros((len(self), len(self._columns)), np.float32)
        for row, own in zip(values, self._channels, strict=True):
            row[: len(own)] = np.nan_to_num(own)
        return dict(zip(self._columns, values.T, strict=True))
