"""Plays takes on characters of the running service, all on one timeline."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from capture.events import TICK_SECONDS
from engine_bridge.service.monitoring.logs import fields
from engine_bridge.service.monitoring.status import TimelineSound, TimelineStatus, TimelineTake
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.stages.stage_runner import StageRunner
from engine_bridge.service.takes.take_parts import SAME_SECONDS, TakePart, TakeParts
from engine_bridge.service.takes.take_track import TakeTrack
from engine_bridge.service.takes.timeline import Timeline
from puppetline import clock
from puppetline.errors import ServiceError

log = logging.getLogger(__name__)


@dataclass
class _Playing:
    """The takes of a character, and the number and moment of the frame that was shown last."""

    track: TakeParts
    shown: int = -1
    shown_at: float = -math.inf

    @property
    def following(self) -> float:
        """Second of the timeline at which the next frame is due; infinity after the last."""
        number = self.shown + 1
        return self.track.at + self.track.times[number] if number < len(self.track.times) else math.inf


class TakePlayback:
    """The takes that play.

    Takes drive their character from the first one's begin on the timeline to the last one's end; before and after, the
    character shows its idle motion. It gets no performer until the takes are stopped.

    Parameters
    ----------
    find : callable
        Returns the stage and the player of a character, None for an unknown name.
    show : callable
        Shows frames of a stage.

    Attributes
    ----------
    timeline : Timeline
    changes : int
        Increases when takes are added or removed and when the position jumps.
    """

    def __init__(
        self,
        find: Callable[[str], tuple[StageRunner, CharacterPlayer] | None],
        show: Callable[[StageRunner, list[Frame]], None],
    ) -> None:
        self._find, self._show = find, show
        self._playing: dict[str, _Playing] = {}
        self.timeline, self.changes = Timeline(), 0

    @property
    def takes(self) -> list[dict[str, Any]]:
        """Each take with its character and its place on the timeline."""
        return [_entry(name, part) for name, each in self._playing.items() for part in each.track.parts]

    def take_on(self, character: str) -> dict[str, Any] | None:
        """Return the first take on a character, as in `takes`; None without one."""
        return next((each for each in self.takes if each["character"] == character), None)

    def add(
        self,
        track: TakeTrack,
        at: float | None = None,
        start: float = 0.0,
        stop: float | None = None,
        beside: bool = False,
        pause: bool = False,
    ) -> dict[str, Any]:
        """Play a take, from its beginning if it is the only one.

        Parameters
        ----------
        track : TakeTrack
        at : float, optional
            Second of the timeline at which the take begins; by default, the one at which it was recorded.
        start, stop : float, optional
            The part of the take that is played, in seconds.
        beside : bool
            Whether the character's other takes stay.
        pause : bool
            Whether the timeline stands at the beginning of the take, if it is the only one.

        Returns
        -------
        dict
            Its entry of `takes`.

        Raises
        ------
        ServiceError
            The part has no frame.
        """
        name, now = track.character.name, clock.now()
        part = TakePart(track, track.offset if at is None else at, start, math.inf if stop is None else stop)
        if not TakeParts([part]).times:
            raise ServiceError(
                f"take {track.take!r}",
                found=f"no frame from second {part.start:g} to second {part.stop:g}",
                expected=f"a part of its {track.seconds:.1f} s",
                fix="Choose an earlier start or a later stop.",
            )
        others = self._playing[name].track.parts if beside and name in self._playing else []
        if not self._playing:
            self.timeline = Timeline()
            self.timeline.move(part.at, now)
            self.timeline.pause(pause, now)
        if name not in self._playing:
            self._reserve(name, True)
        self._put(name, [*others, part])
        return _entry(name, part)

    def replace(self, track: TakeTrack) -> None:
        """Continue with the motion that was computed for a character's new mapping."""
        playing = self._playing.get(track.character.name)
        parts = [] if playing is None else playing.track.parts
        if any(part.track.path == track.path for part in parts):
            changed = [replace(part, track=track) if part.track.path == track.path else part for part in parts]
            self._put(track.character.name, changed)

    def reserve(self) -> None:
        """Keep the characters of the takes from performers, also on stages that a reload has opened again."""
        for name in self._playing:
            self._reserve(name, True)

    def stale(self) -> list[tuple[CharacterPlayer, TakeTrack]]:
        """Return the takes whose motion was computed for another mapping or character than the present one."""
        found = (
            (self._find(name), track)
            for name, each in self._playing.items()
            for track in {id(part.track): part.track for part in each.track.parts}.values()
        )
        return [(at[1], track) for at, track in found if at is not None and at[1].character is not track.character]

    def stop(self, character: str | None = None) -> None:
        """Remove the take of a character, or all, and give the characters back to performers."""
        for name in [each for each in self._playing if character in (None, each)]:
            del self._playing[name]
            found = self._find(name)
            if found is not None:
                runner, player = found
                if player.follows_take:
                    player.release(runner.source.now())
                self._reserve(name, False)
        self._measure()

    def seek(self, position: float, moment: float | None = None) -> None:
        """Jump to a second of the timeline, and wait there until a moment if it is given."""
        timeline = self.timeline
        timeline.move(min(max(position, timeline.start), timeline.end), moment or clock.now())
        self.changes += 1
        for name in self._playing:
            self._ease(name)

    def due(self) -> float:
        """Return the moment at which to call `advance`."""
        if not self._playing:
            return math.inf
        timeline, now = self.timeline, clock.now()
        if timeline.stands(now):
            again = min(each.shown_at for each in self._playing.values()) + TICK_SECONDS
            return min(again, math.inf if timeline.paused else timeline.moment(timeline.position(now)))
        following = (each.following for each in self._playing.values())
        return timeline.moment(min(timeline.end, *following))

    def advance(self) -> None:
        """Show the frames that are due, and begin again or stop at the end."""
        if not self._playing:
            return
        timeline, now = self.timeline, clock.now()
        end = timeline.moment(timeline.end)
        position = timeline.end if now >= end else timeline.position(now)
        for name in [*self._playing]:
            try:
                self._show_take(name, position, now)
            except Exception as error:
                log.exception("the take has ended", extra=fields(character=name, why=str(error)))
                self.stop(name)
        if now >= end and timeline.loop and timeline.end > timeline.start:
            self.seek(timeline.start, end)
        elif now >= end:
            self.stop()

    def status(self) -> TimelineStatus | None:
        """Return the state of the timeline; None if no take plays."""
        timeline, now = self.timeline, clock.now()
        if not self._playing:
            return None
        return TimelineStatus(
            position=round(min(timeline.position(now), timeline.end), 3),
            moment=now if timeline.paused else timeline.moment(timeline.position(now)),
            start=timeline.start,
            end=timeline.end,
            speed=timeline.speed,
            paused=timeline.paused,
            loop=timeline.loop,
            takes=[
                TimelineTake(**each | {"sound": each["sound"] and TimelineSound(**each["sound"])})
                for each in self.takes
            ],
        )

    def _show_take(self, name: str, position: float, now: float) -> None:
        """Show a character's frame at a position, unless it is shown already."""
        playing, found = self._playing[name], self._find(name)
        if found is None:  # a reload has removed it
            del self._playing[name]
            return
        runner, player = found
        track, seconds, clock = playing.track, position - playing.track.at, runner.source.now()
        last = len(track.times) - 1
        over = seconds > track.seconds + SAME_SECONDS and not 0 <= playing.shown < last
        if seconds < 0 or over or not track.fits(player.character):
            playing.shown, playing.shown_at = -1 if seconds < 0 else last, now
            if player.follows_take:
                player.release(clock)
            return
        if not player.follows_take:
            player.follow_take(clock)
        number = track.index(seconds + SAME_SECONDS)
        if playing.shown >= 0 and track.is_cut(number, playing.shown):
            player.follow_take(clock)
        stands = self.timeline.stands(now)
        if number == playing.shown and not (stands and now >= playing.shown_at + TICK_SECONDS):
            return
        moment = now if stands else min(now, self.timeline.moment(track.at + track.times[number]))
        moment = max(moment, playing.shown_at)
        playing.shown, playing.shown_at = number, moment
        frame = player.show_take(clock - (now - moment), int(1e9 * moment), *track.frame(number))
        self._show(runner, [frame])

    def _put(self, name: str, parts: list[TakePart]) -> None:
        self._playing[name] = _Playing(TakeParts(parts))
        self._ease(name)
        self._measure()

    def _ease(self, name: str) -> None:
        """Ease into the take's next frame from what the character shows."""
        self._playing[name].shown = -1
        found = self._find(name)
        if found is not None and found[1].follows_take:
            found[1].follow_take(found[0].source.now())

    def _reserve(self, name: str, on: bool) -> None:
        """Keep a character for its take, or give it back to performers."""
        found = self._find(name)
        if found is not None:
            self._show(found[0], found[0].cue("take", character=name, on=on))

    def _measure(self) -> None:
        self.changes += 1
        spans = [(each.track.at, each.track.at + each.track.seconds) for each in self._playing.values()]
        self.timeline.start = min((start for start, _ in spans), default=0.0)
        self.timeline.end = max((end for _, end in spans), default=0.0)


def _entry(character: str, part: TakePart) -> dict[str, Any]:
    """Return what is said of a part of a take on a character."""
    return {
        "character": character,
        "take": part.track.take,
        "at": part.at,
        "seconds": part.seconds,
        "sound": part.sound,
    }
