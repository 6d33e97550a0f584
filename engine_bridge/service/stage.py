"""A stage: one source of skeletons and the characters that its performers play.

It knows no clock and no socket. What it makes depends on the events it is given and on nothing else, so that a take,
which is these events, plays to the same controls again: to the very same if it was recorded from the start, otherwise
as soon as the filters, which start again with the take, have forgotten what was before it.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.events import TICK, Cue, Event, Lost, Tick
from capture.sensor_tilt import Level
from capture.skeleton import LOST, SkeletonFrame
from engine_bridge.service.character_player import CharacterPlayer
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.user_assignment import People, Presence, UserAssignment
from puppetline.errors import ServiceError

BLIND = 5 * TICK
"""Seconds without any event after which it was not the people who were away: a source gives ticks while it runs."""


@dataclass(frozen=True)
class Direction:
    """How a stage treats the people before it.

    Attributes
    ----------
    people : {"each", "nearest", "queue"}
    turn : float
        Seconds of a turn in a queue.
    lost_after : float
        Seconds after which somebody who is not seen has left.
    least_confidence : float
        A joint of less is lost.
    """

    people: People = "each"
    turn: float = 60.0
    lost_after: float = 0.5
    least_confidence: float = 0.25


class Stage:
    """Characters, and the performers of one source.

    Parameters
    ----------
    name : str
    roles : sequence of CharacterPlayer
        At least one; each name once.
    direction : Direction
    """

    def __init__(self, name: str, roles: Sequence[CharacterPlayer], direction: Direction) -> None:
        self.name = name
        self.roles = list(roles)
        self._direction = direction
        self.casting = UserAssignment(direction.people, direction.turn, [None] * len(self.roles))
        self._latest: dict[int, float] = {}
        self._time = -math.inf

    def step(self, event: Event, received: int) -> list[Frame]:
        """Take an event and return the frames of the characters that it moves.

        Parameters
        ----------
        event : Event
            No earlier than the one before.
        received : int
            `time.monotonic_ns` at which it came.

        Raises
        ------
        ServiceError
            A cue that cannot be followed.
        """
        if event.time - self._time > BLIND and math.isfinite(self._time):
            self.casting.blind(event.time - self._time)
        self._time = event.time
        match event:
            case SkeletonFrame():
                return self._perform(event, received)
            case Lost():
                self.casting.gone(event.user)
            case Cue(do="stage"):
                self._resume(event)
                return []
            case Cue():
                self._follow(event)
            case Tick():
                pass
        self._recast(event.time)
        return self._pass_time(event.time, received)

    def _perform(self, frame: SkeletonFrame, received: int) -> list[Frame]:
        confidence = np.where(frame.confidence < self._direction.least_confidence, np.float32(LOST), frame.confidence)
        known = confidence > LOST
        if known.any() and frame.time > self._latest.get(frame.user, -np.inf):
            self.casting.see(frame.user, frame.time, _distance(frame.positions[known]))
        self._recast(frame.time)
        if frame.user not in self.casting.present or frame.time <= self._latest.get(frame.user, -np.inf):
            return self._pass_time(frame.time, received)
        self._latest[frame.user] = frame.time
        frame = replace(frame, confidence=confidence)
        shown = [role.perform(frame, received) for role in self.roles if role.user == frame.user]
        return shown + self._pass_time(frame.time, received)

    def _recast(self, time: float) -> None:
        """Let people come and go."""
        casting = self.casting
        for user, presence in list(casting.present.items()):
            if time - presence.seen > self._direction.lost_after:
                casting.gone(user)
        casting.recast(time)
        for role, performer in zip(self.roles, casting.cast, strict=True):
            if role.user == performer:
                continue
            if role.user is not None:
                role.leave(time)
            if performer is not None:
                role.enter(performer, time)
        self._latest = {user: self._latest[user] for user in self._latest if user in casting.present}

    def _pass_time(self, time: float, received: int) -> list[Frame]:
        return [frame for role in self.roles if (frame := role.pass_time(time, received)) is not None]

    def _follow(self, cue: Cue) -> None:
        chosen = self._named(cue.arguments.get("character"))
        match cue.do:
            case "calibrate":
                if not [role for role in chosen if role.calibrate(cue.time)]:
                    raise self._nobody(cue.arguments.get("character"))
            case "mirror":
                for role in chosen:
                    on = cue.arguments.get("on")
                    role.set_mirror(not role.mirror if on is None else bool(on), cue.time)
            case "begin":
                for role in chosen:
                    role.begin(cue.time, cue.arguments.get("calibration"))
            case "choose_user":
                self._choose(chosen[0], cue.arguments.get("user"), cue.time)
            case "level":
                level = self._level_of(cue)
                for role in chosen:
                    role.set_level(level, cue.time)

    def _named(self, character: str | None) -> list[CharacterPlayer]:
        """Return the role of that name, or all roles for None."""
        names = [role.character.name for role in self.roles]
        if character is not None and character not in names:
            raise ServiceError(
                f"stage {self.name}",
                found=f"no character {character!r}",
                expected=f"one of {', '.join(names)}",
                fix="Name one of these.",
            )
        return [role for role in self.roles if character in (None, role.character.name)]

    def _choose(self, role: CharacterPlayer, user: int | None, time: float) -> None:
        if user is not None and user not in self.casting.present:
            here = ", ".join(map(str, self.casting.present)) or "nobody"
            raise ServiceError(
                f"stage {self.name}",
                found=f"no user {user} before the sensor",
                expected=f"one of them: {here}",
                fix="The status of describe says who is there.",
            )
        self.casting.choose(self.roles.index(role), user, time)

    def _level_of(self, cue: Cue) -> Level:
        try:
            return Level.of_json(cue.arguments)
        except ValueError as error:
            raise ServiceError(
                f"stage {self.name}",
                found=f"a sensor that stands like {cue.arguments}",
                expected="tilt and roll in degrees, height in metres",
                fix="Measure it again; until then it counts as before.",
            ) from error

    def _nobody(self, character: str | None) -> ServiceError:
        return ServiceError(
            f"stage {self.name}",
            found=f"nobody who plays {character or 'a character'}",
            expected="a performer whom the sensor sees",
            fix="Calibrate when somebody is there.",
        )

    def replace_roles(self, roles: Sequence[CharacterPlayer]) -> None:
        """Take over characters that were loaded anew; performers stay with those of the same name."""
        names = [role.character.name for role in self.roles]
        before = [names.index(name) if name in names else None for name in (role.character.name for role in roles)]
        for role, k in zip(roles, before, strict=True):
            if k is not None:
                role.succeed(self.roles[k])
        self.casting.rearrange(before)
        self.roles = list(roles)

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return who is there and who plays what, for the cue ``stage`` that begins a take.

        Parameters
        ----------
        now : float
            Time on the source's clock, for a stage that was given no event yet; others are as of their last event.
        """
        casting = self.casting
        return {
            "time": self._time if math.isfinite(self._time) else now,
            "direction": asdict(self._direction),
            "people": [
                {"user": user, "chosen": user in casting.chosen, **asdict(presence)}
                for user, presence in casting.present.items()
            ],
            "characters": {
                role.character.name: {"since": since, **role.snapshot()}
                for role, since in zip(self.roles, casting.since, strict=True)
            },
        }

    def _resume(self, cue: Cue) -> None:
        """Continue where a take begins; characters that it does not name are nobody's."""
        try:
            shift = cue.time - float(cue.arguments["time"])
            direction = Direction(**cue.arguments["direction"])
            characters = cue.arguments["characters"]
            recorded = [characters.get(role.character.name) for role in self.roles]
            casting = UserAssignment(
                direction.people,
                direction.turn,
                [None if each is None else each["user"] for each in recorded],
                [0.0 if each is None else float(each["since"]) + shift for each in recorded],
            )
            for each in cue.arguments["people"]:
                nearer = each["nearer_since"]
                casting.present[int(each["user"])] = Presence(
                    float(each["waits_since"]) + shift,
                    float(each["seen"]) + shift,
                    float(each["distance"]),
                    None if nearer is None else float(nearer) + shift,
                )
                if each["chosen"]:
                    casting.chosen.add(int(each["user"]))
            if any(user is not None and user not in casting.present for user in casting.cast):
                raise ValueError("a performer who is not there")
            for role, snapshot in zip(self.roles, recorded, strict=True):
                if snapshot is not None:
                    role.resume(snapshot, cue.time, shift)
        except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
            raise ServiceError(
                f"stage {self.name}",
                found=f"a take with a damaged beginning ({type(error).__name__}: {error})",
                expected="a take as it was recorded",
                fix="Remove the second line of the take; it then plays like any other recording.",
            ) from error
        self._direction, self.casting = direction, casting


def _distance(joints: NDArray[np.float64]) -> float:
    """Return how far the middle of a body is from the sensor, along the floor; metres."""
    x, z = np.sort(joints[:, ::2], axis=0)[len(joints) // 2]  # a median, without np.median's 40 µs
    return float(np.hypot(x, z))
