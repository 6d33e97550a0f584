"""What senders get wrong, for a minute on a given clock: the fastest joint, and performers who are exchanged.

Two people walk 2 m apart. Their sender exchanges and renews their numbers, sends zeros, numbers that are not
finite, the last position of a joint for ever, and messages that no program understands.

    python -m benchmarks.live_dirt
"""

import logging
import random
import socket
import struct
from collections.abc import Iterator
from contextlib import closing

import numpy as np
from numpy.typing import NDArray
from puppetline.examples.performances import PERFORMANCES

from benchmarks.datagrams import NAMES
from capture.events import Lost
from capture.network.osc import bundle, encode
from capture.network.source import OscSource, open_osc
from capture.skeleton import JOINT_INDEX, JOINTS, LOST, SkeletonFrame
from puppetline import clock
from puppetline.clock import MachineClock

SECONDS, FPS = 60, 30
APART_METRES = 2.0
"""Distance between the two people, in metres."""

BAD_MESSAGES = (
    b"/VMC/Ext/Bone/Pos\0\0\0,sf\0" + b"Hips\0\0\0\0" + struct.pack(">f", float("nan")),
    encode("/VMC/Ext/Bone/Pos", "LeftHand", 0.0),
    encode("/joint", "nose", 1, 0.0, 0.0, 0.0),
    b"/joint\0\0,q\0\0",
)


class GivenClock(MachineClock):
    """A clock that stands until its `time` is set."""

    time = 1000.0

    def now(self) -> float:
        """Return the time in seconds."""
        return self.time


def people() -> NDArray[np.float64]:
    """Return the joints (T, 2, 20, 3) of two people who move, each in their own place."""
    frames = [frame for frame in PERFORMANCES["walk"]().frames() if (frame.confidence > LOST).all()]
    positions = np.array([frame.positions for frame in frames])
    positions -= positions[:, :1] * [1, 0, 1]
    there_and_back = np.concatenate([positions, positions[::-1]])
    rows = np.arange(SECONDS * FPS)
    both = [there_and_back[(rows + ahead) % len(there_and_back)] for ahead in (0, 200)]
    return np.stack([both[0] - [APART_METRES / 2, 0, -3], both[1] + [APART_METRES / 2, 0, 3]], axis=1)


def datagrams(
    joints: NDArray[np.float64], number: int, held: NDArray[np.float64], chance: random.Random
) -> list[bytes]:
    """Return what a sender in OSCeleton's format makes of a frame (2, 20, 3) of both people."""
    second = number / FPS
    users = [1, 2] if int(second / 5) % 2 == 0 else [2, 1]
    if second > SECONDS / 2:
        users = [user + 10 * int(second / 4) for user in users]
    sent = []
    for user, pose, last in zip(users, joints, held, strict=True):
        messages = []
        for joint, position in zip(JOINTS, pose, strict=True):
            name = encode("/joint", NAMES[joint], user, *(float(1000 * value) for value in position))
            if joint == "hand_left" and int(second) % 7 == 3:
                name = encode("/joint", NAMES[joint], user, 0.0, 0.0, 0.0)
            if joint == "hand_right" and int(second) % 9 in (4, 5, 6):
                name = encode(
                    "/joint", NAMES[joint], user, *(float(1000 * value) for value in last[JOINT_INDEX[joint]])
                )
            if joint == "head" and int(second) % 11 == 5:
                name = name[:-12] + struct.pack(">fff", float("nan"), float("inf"), 0.0)
            messages.append(name)
        if chance.random() < 0.3:
            messages.insert(chance.randrange(len(messages)), chance.choice(BAD_MESSAGES))
        sent.append(bundle(*messages))
    chance.shuffle(sent)
    return sent


def received(source: OscSource, given: GivenClock) -> Iterator[tuple[int, SkeletonFrame | Lost]]:
    """Yield what a source makes of the minute, with the number of each frame."""
    chance, every = random.Random(1), people()
    held = every[0].copy()
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
        for number, joints in enumerate(every):
            given.time += 1 / FPS
            if int(number / FPS) % 9 == 3:
                held = joints.copy()
            for each in datagrams(joints, number, held, chance):
                sender.sendto(each, ("127.0.0.1", source.port))
            before = source.counts.received
            while source.counts.received < before + len(joints):
                for event in source.receive():
                    if isinstance(event, SkeletonFrame | Lost):
                        yield number, event


def main() -> None:
    """Print the fastest joint and the number of frames in which performers are exchanged."""
    given, every = GivenClock(), people()
    fastest, exchanged, frames = 0.0, 0, 0
    logging.getLogger("capture.network.refusals").setLevel(logging.ERROR)
    seen: dict[int, tuple[int, SkeletonFrame]] = {}
    person_of: dict[int, int] = {}
    with clock.use(given), closing(open_osc("127.0.0.1:0?units=mm&mirrored=0")) as source:
        for number, event in received(source, given):
            if isinstance(event, Lost):
                continue
            frames += 1
            known = event.confidence > LOST
            away = np.linalg.norm(every[number][:, known] - event.positions[known], axis=2)
            person = int(np.median(away, axis=1).argmin())
            exchanged += person_of.setdefault(event.user, person) != person
            before = seen.get(event.user)
            if before is not None:
                both = known & (before[1].confidence > LOST)
                ways = np.linalg.norm(event.positions - before[1].positions, axis=1)[both]
                fastest = max(fastest, float(ways.max()) * FPS / max(number - before[0], 1))
            seen[event.user] = number, event
        print(f"{frames} frames, {len(seen)} performers, {exchanged} frames of another performer")
        print(f"fastest joint: {fastest:.1f} m/s")
        print("refused:", ", ".join(f"{count} × {reason}" for reason, count in source.counts.refused.items()))


if __name__ == "__main__":
    main()
