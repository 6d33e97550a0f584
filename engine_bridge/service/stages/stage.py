"""A stage: one source of skeletons and the characters that its performers drive.

A stage has no clock and no socket: its frames depend on its events only. A take, which records these events, therefore
replays the same controls: all of them if it was recorded from the start, otherwise as soon as the filters, which start
again with the take, no longer depend on what was before it.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.events import TICK_SECONDS, Cue, Event, Lost
from capture.sensor_tilt import SensorTilt
from capture.skeleton import LOST, SkeletonFrame
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.stages.user_assignment import People, Presence, UserAssignment
from puppetline.errors import ServiceError, unknown_name

PREPARATION_SECONDS = 0.3
"""Time from a calibration to its use if the source is a recording, in seconds, so that every replay is the same.

Computing it takes less. With a live source, it is used as soon as it is computed.
"""

SOURCE_GAP_SECONDS = 5 * TICK_SECONDS
"""Time without any event after which a gap counts as the source's, not as the performers' absence, in seconds.

A running source emits ticks.
"""


RETURN_METRES = 0.3
"""Distance in front of `StageSettings.beyond` at which people count as present again, in metres."""


@dataclass(frozen=True)
class StageSettings:
    """Settings of how a stage assigns performers to characters.

    Attributes
    ----------
    people : {"each", "nearest", "queue"}
    turn : float
        Duration of a turn in a queue, in seconds.
    lost_after : float
        Time after which a performer who is not tracked has left, in seconds.
    least_confidence : float
        Confidence below which a joint is lost.
    beyond : float or None
        Distance from the sensor in metres beyond which people count as gone, so that stepping back ends a turn.
    """

    people: People = "each"
    turn: float = 60.0
    lost_after: float = 0.5
    least_confidence: float = 0.25
    beyond: float | None = None


class Stage:
    """Characters, and the performers of one source.

    Parameters
    ----------
    name : str
    players : sequence of CharacterPlayer
        At least one; each name once.
    settings : StageSettings
    """

    def __init__(self, name: str, players: Sequence[CharacterPlayer], settings: StageSettings) -> None:
        self.name = name
        self.players = list(players)
        self._settings = settings
        self.assignment = UserAssignment(settings.people, settings.turn, [None] * len(self.players))
        self._latest: dict[int, float] = {}
        self._time = -math.inf

    def step(self, event: Event, received: int) -> list[Frame]:
        """Process an event and return the frames of the characters that it moves.

        Parameters
        ----------
        event : Event
            No earlier than the one before.
        received : int
            `puppetline.clock.now_ns` at which it arrived.

        Raises
        ------
        ServiceError
            A cue that cannot be carried out.
        """
        if event.time - self._time > SOURCE_GAP_SECONDS and math.isfinite(self._time):
            self.assignment.blind(event.time - self._time)
        self._time = event.time
        match event:
            case SkeletonFrame():
                return self._perform(event, received)
            case Lost(again=True):
                for player in self.players:
                    if player.user == event.user:
                        player.begin_again(event.time)
            case Lost():
                self.assignment.gone(event.user)
            case Cue(do="stage"):
                self._resume(event)
                return []
            case Cue(do="sound"):  # only written beside the events, so it shows no frame
                return []
            case Cue():
                self._follow(event)
        self._assign(event.time)
        return self._pass_time(event.time, received)

    def beginnings(self, moment: float, recorded: bool, directed: Collection[str] = ()) -> list[Cue]:
        """Return cues for the calibrations to use from now on.

        Parameters
        ----------
        moment : float
            Time of the next event.
        recorded : bool
            Whether the source is a recording.
        directed : collection of str
            Characters whose cues are in a take.
        """
        return [
            Cue(moment, "begin", {"character": player.character.name, "calibration": player.next_calibration.to_json()})
            for player in self.players
            if player.next_calibration is not None
            and player.character.name not in directed
            and (
                moment >= player.next_calibration.asked + PREPARATION_SECONDS
                if recorded
                else player.next_calibration.working.done()
            )
        ]

    def _perform(self, frame: SkeletonFrame, received: int) -> list[Frame]:
        confidence = np.where(frame.confidence < self._settings.least_confidence, np.float32(LOST), frame.confidence)
        known = confidence > LOST
        if known.any() and frame.time > self._latest.get(frame.user, -np.inf):
            distance = _distance(frame.positions[known])
            if self._near(frame.user, distance):
                self.assignment.see(frame.user, frame.time, distance)
        self._assign(frame.time)
        if frame.user not in self.assignment.present or frame.time <= self._latest.get(frame.user, -np.inf):
            return self._pass_time(frame.time, received)
        self._latest[frame.user] = frame.time
        frame = replace(frame, confidence=confidence)
        shown = [player.perform(frame, received) for player in self.players if player.user == frame.user]
        return shown + self._pass_time(frame.time, received)

    def _near(self, user: int, distance: float) -> bool:
        """Return whether somebody is near enough; who is away must come nearer by `RETURN_METRES`."""
        beyond = math.inf if self._settings.beyond is None else self._settings.beyond
        return distance < beyond - (0.0 if user in self.assignment.present else RETURN_METRES)

    def _assign(self, time: float) -> None:
        """Remove performers who have left, and assign the others."""
        assignment = self.assignment
        for user, presence in list(assignment.present.items()):
            if time - presence.seen > self._settings.lost_after:
                assignment.gone(user)
        assignment.assign(time)
        for player, performer in zip(self.players, assignment.performers, strict=True):
            if player.user == performer:
                continue
            if player.user is not None:
                player.leave(time)
            if performer is not None:
                player.enter(performer, time)
        self._latest = {user: self._latest[user] for user in self._latest if user in assignment.present}

    def _pass_time(self, time: float, received: int) -> list[Frame]:
        return [frame for player in self.players if (frame := player.pass_time(time, received)) is not None]

    def _follow(self, cue: Cue) -> None:
        chosen = self._named(cue.arguments.get("character"))
        match cue.do:
            case "calibrate":
                if not [player for player in chosen if player.calibrate(cue.time)]:
                    raise ServiceError(
                        f"stage {self.name}",
                        found=f"no performer for {cue.arguments.get('character') or 'any character'}",
                        expected="a performer in view of the sensor",
                        fix="Calibrate when a performer is in view.",
                    )
            case "mirror":
                self._mirror(chosen, cue.arguments.get("on"), cue.time)
            case "begin":
                for player in chosen:
                    player.begin(cue.time, cue.arguments.get("calibration"))
            case "choose_user":
                self._choose(chosen[0], cue.arguments.get("user"), cue.time)
            case "take":
                self._reserve(chosen, bool(cue.arguments.get("on")))
            case "level":
                sensor = self._sensor_of(cue)
                for player in chosen:
                    player.set_sensor(sensor, cue.time)

    def _named(self, character: str | None) -> list[CharacterPlayer]:
        """Return the player of a character, or all players for None."""
        names = [player.character.name for player in self.players]
        if character is not None and character not in names:
            raise unknown_name(f"stage {self.name}", f"no character {character!r}", names)
        return [player for player in self.players if character in (None, player.character.name)]

    def _mirror(self, chosen: Sequence[CharacterPlayer], on: Any, time: float) -> None:
        for player in chosen:
            player.set_mirror(not player.motion.mirror if on is None else bool(on), time)

    def _reserve(self, chosen: Sequence[CharacterPlayer], on: bool) -> None:
        """Give characters to takes, or back to performers."""
        for number in map(self.players.index, chosen):
            if on:
                self.assignment.reserve(number)
            else:
                self.assignment.reserved.discard(number)

    def _choose(self, player: CharacterPlayer, user: int | None, time: float) -> None:
        if user is not None and user not in self.assignment.present:
            here = ", ".join(map(str, self.assignment.present)) or "no user"
            raise ServiceError(
                f"stage {self.name}",
                found=f"no user {user} in view of the sensor",
                expected=f"one of the users in view: {here}",
                fix='List the users in view: {"do": "describe"}.',
            )
        number = self.players.index(player)
        if number in self.assignment.reserved:
            raise ServiceError(
                player.character.name,
                found="a character that a take drives",
                expected="a character without a take",
                fix='Stop the take first: {"do": "stop"}',
            )
        self.assignment.choose(number, user, time)

    def _sensor_of(self, cue: Cue) -> SensorTilt:
        try:
            return SensorTilt.of_json(cue.arguments)
        except ValueError as error:
            raise ServiceError(
                f"stage {self.name}",
                found=f"a position of the sensor that is not understood ({cue.arguments})",
                expected="tilt and roll in degrees, height in metres",
                fix="Measure it again; until then, the previous position is used.",
            ) from error

    def replace_players(self, players: Sequence[CharacterPlayer]) -> None:
        """Replace characters by those with other puppets; performers stay with those of the same name."""
        names = [player.character.name for player in self.players]
        new = [player.character.name for player in players]
        before = [names.index(name) if name in names else None for name in new]
        for player, k in zip(players, before, strict=True):
            if k is not None and player is not self.players[k]:
                player.succeed(self.players[k])
        self.assignment.rearrange(before)
        self.players = list(players)

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return the performers in view and their characters, for the cue ``stage`` that begins a take.

        Parameters
        ----------
        now : float
            Time on the source's clock, used if the stage has processed no event yet.
        """
        assignment = self.assignment
        return {
            "time": self._time if math.isfinite(self._time) else now,
            "direction": {name: value for name, value in asdict(self._settings).items() if value is not None},
            "people": [
                {"user": user, "chosen": user in assignment.chosen, **asdict(presence)}
                for user, presence in assignment.present.items()
            ],
            "reserved": [self.players[number].character.name for number in sorted(assignment.reserved)],
            "characters": {
                player.character.name: {"since": since, **player.snapshot()}
                for player, since in zip(self.players, assignment.since, strict=True)
            },
        }

    def _resume(self, cue: Cue) -> None:
        """Continue where a take begins; characters that it does not name have no performer."""
        arguments = cue.arguments
        try:
            shift = cue.time - float(arguments["time"])
            settings = StageSettings(**arguments["direction"])
            characters = arguments["characters"]
            recorded = [characters.get(player.character.name) for player in self.players]
            assignment = UserAssignment(
                settings.people,
                settings.turn,
                [None if each is None else each["user"] for each in recorded],
                [0.0 if each is None else float(each["since"]) + shift for each in recorded],
            )
            for each in arguments["people"]:
                nearer = each["nearer_since"]
                assignment.present[int(each["user"])] = Presence(
                    float(each["waits_since"]) + shift,
                    float(each["seen"]) + shift,
                    float(each["distance"]),
                    None if nearer is None else float(nearer) + shift,
                )
                if each["chosen"]:
                    assignment.chosen.add(int(each["user"]))
            reserved = arguments.get("reserved", [])
            assignment.reserved = {k for k, each in enumerate(self.players) if each.character.name in reserved}
            if any(user is not None and user not in assignment.present for user in assignment.performers):
                raise ValueError("a performer who is not in view")
            for player, snapshot in zip(self.players, recorded, strict=True):
                if snapshot is not None:
                    player.resume(snapshot, cue.time, shift)
        except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
            raise ServiceError(
                f"stage {self.name}",
                found=f"a take with a damaged beginning ({type(error).__name__}: {error})",
                expected="a take as it was recorded",
                fix="Remove the second line of the take; it then plays like any other recording.",
            ) from error
        self._settings, self.assignment = settings, assignment


def _distance(joints: NDArray[np.float64]) -> float:
    """Return the distance of the middle of a body from the sensor along the floor, in metres."""
    x, z = np.sort(joints[:, ::2], axis=0)[len(joints) // 2]  # a median, without np.median's 40 µs
    return float(np.hypot(x, z))
