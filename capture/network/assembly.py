"""Assembly of a performer's frames from parts that arrive one by one without an end mark.

A frame is complete as soon as it has all parts of the frame before. If a part is missing, the frame ends when a part
arrives for the second time, when the sender's time changes, or after `PART_TIMEOUT_SECONDS`.
"""

from dataclasses import dataclass, field

from capture.network.dialect import Part, Values

PART_TIMEOUT_SECONDS = 0.010
"""Time after the last part at which an incomplete frame ends. Senders send all datagrams of a frame at once."""


@dataclass(frozen=True, slots=True)
class CompleteFrame:
    """The parts of a frame.

    Attributes
    ----------
    parts : dict
        Values of each part by its name.
    time : float
        Arrival time of the last part.
    """

    parts: dict[str, Values]
    time: float


@dataclass(slots=True)
class FrameAssembly:
    """The assembly of one performer's frames.

    Attributes
    ----------
    parts : dict
        Parts of a frame that is not complete yet.
    time : float
        Arrival time of the last part.
    """

    parts: dict[str, Values] = field(default_factory=dict)
    time: float = 0.0
    _stamp: float | None = field(default=None, init=False)
    _expected: set[str] = field(default_factory=set, init=False)

    def add(self, part: Part, time: float, *, end_follows: bool = False) -> list[CompleteFrame]:
        """Add a part that arrived at `time`; return the frames that it completes, at most two.

        If `end_follows`, only a call of `end` completes the frame.
        """
        if not (self.parts or end_follows) and self._is_late(part, time):
            self._expected.add(part.name)
            return []
        ended = []
        if part.name in self.parts or (self.parts and part.stamp != self._stamp):
            ended = self.end()
        self.parts[part.name] = part.values
        self._stamp, self.time = part.stamp, time
        if not end_follows and self._expected and self._expected <= self.parts.keys():
            ended += self.end()
        return ended

    def end(self) -> list[CompleteFrame]:
        """End the frame and return it, if it has any part."""
        if not self.parts:
            return []
        frame = CompleteFrame(self.parts, self.time)
        self._expected, self.parts = set(self.parts), {}
        return [frame]

    def _is_late(self, part: Part, time: float) -> bool:
        """Return whether a part belongs to the frame that has just been completed without it."""
        if part.name in self._expected or not self._expected:
            return False
        return time - self.time < PART_TIMEOUT_SECONDS if part.stamp is None else part.stamp == self._stamp
