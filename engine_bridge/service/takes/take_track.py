"""The motion of a character in a take, which is computed once, so that it can be played from any moment."""

from bisect import bisect_right
from pathlib import Path

from engine_bridge.performance.pose import Pose
from engine_bridge.service.players.appearance import Appearance
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.takes.take_stage import TakeStage
from puppetline.errors import ServiceError
from solver.motion.deformer import Deformer, DeformerState

STATE_FRAMES = 32
"""Number of frames from one stored state of the deformer to the next; a jump computes up to this many frames."""

MAX_FRAMES = 54_000
"""Maximum number of frames of a take that plays: half an hour at 30 frames per second, which takes about 230 MB."""


class TakeTrack:
    """A character's motion in a take.

    Each frame is computed from the one before it, as the live character's frames are. Stored states make any frame
    reachable with the same result.

    Parameters
    ----------
    player : CharacterPlayer
        The live character; only its character, settings and idle motion are used, in any thread.
    path : Path
        A take, or any recording.
    part : str, optional
        Name of the character in the take whose performer drives this one; the character's own by default.

    Attributes
    ----------
    take : str
    path : Path
    part : str or None
    character : StreamedCharacter
    times : list of float
        Times of the frames, in seconds since the take's first event.
    offset : float
        Second of the timeline at which the take began, see `TakeStage`.
    sound : dict or None
        See `TakeStage`.
    note : str
        The first error in the take; empty for an undamaged take.

    Raises
    ------
    PuppetlineError
        The take cannot be read, is one of other characters, has no motion, or is too long.
    """

    def __init__(self, player: CharacterPlayer, path: Path, part: str | None = None) -> None:
        self.take, self.path, self.part, self.character = path.stem, path, part, player.character
        self.times: list[float] = []
        self._frames: list[Appearance] = []
        self._solved: Pose | None = None
        self._states: list[DeformerState] = []
        other = player.another()
        self._motion, deformer = other.motion, other.motion.deformer
        stage, state = TakeStage(other, path, part), deformer.state
        for time in stage.frames():
            if len(self.times) % STATE_FRAMES == 0:
                self._states.append(state)
            if len(self.times) == MAX_FRAMES:
                raise _error(path, f"a take of more than {MAX_FRAMES} frames", "a shorter take", "Trim it first.")
            self.times.append(time)
            shown = other.shown
            assert shown is not None  # noqa: S101 - the stage has shown a frame
            # nobody is calibrated while a take plays, in particular not in each pass of a loop
            self._frames.append(shown._replace(state="performing") if shown.state == "calibrating" else shown)
            if len(self.times) % STATE_FRAMES == 0:
                state = deformer.state
        self.offset, self.note, self.sound = stage.offset, stage.note, stage.sound
        if not self.times:
            raise _error(path, "a take without motion", "frames of a performer", stage.note or "Record it again.")
        self._next = len(self.times)

    @property
    def seconds(self) -> float:
        """Time of the last frame."""
        return self.times[-1]

    def fits(self, character: StreamedCharacter) -> bool:
        """Tell whether a character can show the frames; its mapping may have changed since they were computed."""
        ours, theirs = self.character.prepared, character.prepared
        return ours.model is theirs.model and len(ours.puppet.handle) == len(theirs.puppet.handle)

    def index(self, seconds: float) -> int:
        """Return the number of the frame that is shown at a time: the last one that is not later, or the first."""
        return max(0, bisect_right(self.times, seconds) - 1)

    def frame(self, number: int) -> tuple[Appearance, tuple[Deformer, Pose]]:
        """Return what a frame shows, and what this track's deformer has computed for it."""
        if not self._next - 1 <= number < self._next + STATE_FRAMES or self._solved is None:
            block = number // STATE_FRAMES
            self._motion.deformer.resume(self._states[block])
            self._next = block * STATE_FRAMES
        for each in self._frames[self._next : number + 1]:
            self._solved = self._motion.solve(each.target, each.channels)
        self._next = number + 1
        assert self._solved is not None  # noqa: S101 - a state is followed by at least one frame
        return self._frames[number], (self._motion.deformer, self._solved)


def _error(path: Path, found: str, expected: str, fix: str) -> ServiceError:
    return ServiceError(f"take {path.stem!r}", found=found, expected=expected, fix=fix)
