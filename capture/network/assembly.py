"""When a performer's frame is whole, where joints come one by one and nobody says which was the last.

A frame is whole as soon as it has every part that the one before had: no waiting. If one is missing, it ends when a
part comes for the second time, when the sender's time changes, or after `QUIET`.
"""

from dataclasses import dataclass, field

from capture.network.dialect import Part, Values

QUIET = 0.010
"""Seconds without a part after which no more are expected. Senders write a frame's datagrams in one go."""


@dataclass(frozen=True, slots=True)
class Whole:
    """A frame's parts.

    Attributes
    ----------
    parts : dict
        From the name of a part to its values.
    time : float
        When the last one came.
    """

    parts: dict[str, Values]
    time: float


@dataclass(slots=True)
class Assembly:
    """Puts together the frames of one performer.

    Attributes
    ----------
    parts : dict
        What has come of a frame that is not whole yet.
    time : float
        When the last part came.
    """

    parts: dict[str, Values] = field(default_factory=dict)
    time: float = 0.0
    _stamp: float | None = field(default=None, init=False)
    _expected: set[str] = field(default_factory=set, init=False)

    def add(self, part: Part, time: float, *, end_follows: bool = False) -> list[Whole]:
        """Take a part that came at `time`; return the frames that are whole by it, at most two.

        Where `end_follows`, the sender itself says when the frame is whole: `end` will be called.
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

    def end(self) -> list[Whole]:
        """Return the frame as it is; none if nothing has come of it."""
        if not self.parts:
            return []
        whole = Whole(self.parts, self.time)
        self._expected, self.parts = set(self.parts), {}
        return [whole]

    def _is_late(self, part: Part, time: float) -> bool:
        """Tell whether a part belongs to the frame that has just been whole without it."""
        if part.name in self._expected or not self._expected:
            return False
        return time - self.time < QUIET if part.stamp is None else part.stamp == self._stamp
