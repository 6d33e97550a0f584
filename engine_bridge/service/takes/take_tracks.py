"""Keeps the motion of takes, so that they play again at once."""

from pathlib import Path

from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.takes.take_track import TakeTrack

KEPT_FRAMES = 9_000
"""Number of frames that are kept, unless one take has more: five minutes at 30 frames per second, about 40 MB."""


class TakeTracks:
    """The motion of takes on characters, which is computed again only after the take or the character has changed.

    The motion that was asked for last is kept, up to `KEPT_FRAMES`. One thread at a time may ask.
    """

    def __init__(self) -> None:
        self._kept: list[tuple[tuple[object, ...], tuple[object, ...], TakeTrack]] = []

    def of(self, player: CharacterPlayer, path: Path, part: str | None = None) -> TakeTrack:
        """Return a character's motion in a take; see `TakeTrack`.

        Raises
        ------
        PuppetlineError
        """
        file = path.stat() if path.exists() else None
        take = (path, part, file and (file.st_mtime_ns, file.st_size))
        moved = (player, player.character, player.motion.idle)
        same = (
            each
            for each in self._kept
            if each[0] == take and all(one is other for one, other in zip(each[1], moved, strict=True))
        )
        newest = next(same, None) or (take, moved, TakeTrack(player, path, part))
        self._kept = [newest, *(each for each in self._kept if each is not newest)]
        while len(self._kept) > 1 and sum(len(track.times) for _, _, track in self._kept) > KEPT_FRAMES:
            self._kept.pop()
        return newest[2]
