"""Example performances as the datagrams that OSCeleton would send (``-xr`` and ``-r``: raw millimetres, mirrored)."""

from itertools import cycle, islice

from puppetline.examples.performances import PERFORMANCES

from capture.network.osc import bundle, encode
from capture.skeleton import JOINTS, LOST, SkeletonFrame

NAMES = {"hip_center": "waist", "spine": "torso", "shoulder_center": "neck", "head": "head"} | {
    f"{joint}_{side}": f"{side[0]}_{joint}"
    for joint in ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "foot")
    for side in ("left", "right")
}
"""OSCeleton's names of the joints."""

OFFSET_FRAMES = 101
"""Frames by which each performer is ahead of the previous one, so that their poses differ."""


def datagram(frame: SkeletonFrame, user: int) -> bytes:
    """Return a frame as a bundle without lost joints."""
    return bundle(
        *(
            encode("/joint", NAMES[joint], user, *(float(1000 * value) for value in position))
            for joint, position, sure in zip(JOINTS, frame.positions, frame.confidence, strict=True)
            if sure > LOST
        )
    )


def lost(user: int) -> bytes:
    """Return the message that OSCeleton sends when a performer leaves."""
    return encode("/lost_user", user)


def bodies(users: int) -> list[list[bytes]]:
    """Return all example performances in turn: for each frame, one datagram for each of the users 1 to `users`."""
    frames = [frame for make in PERFORMANCES.values() for frame in make().frames() if (frame.confidence > LOST).any()]
    of_user = [
        [
            datagram(frame, user)
            for frame in islice(cycle(frames), user * OFFSET_FRAMES, user * OFFSET_FRAMES + len(frames))
        ]
        for user in range(1, users + 1)
    ]
    return [list(together) for together in zip(*of_user, strict=True)]
