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
"""What OSCeleton calls our joints."""

APART = 101
"""Frames by which one performer is ahead of the next, so that they do not all do the same."""


def datagram(frame: SkeletonFrame, user: int) -> bytes:
    """Return a frame as a bundle; what the sensor has lost is not in it."""
    return bundle(
        *(
            encode("/joint", NAMES[joint], user, *(float(1000 * value) for value in position))
            for joint, position, sure in zip(JOINTS, frame.positions, frame.confidence, strict=True)
            if sure > LOST
        )
    )


def lost(user: int) -> bytes:
    """Return what OSCeleton sends when a performer has gone."""
    return encode("/lost_user", user)


def bodies(users: int) -> list[list[bytes]]:
    """Return all example performances, one after the other: for each frame a datagram of each user from 1 on."""
    frames = [frame for make in PERFORMANCES.values() for frame in make().frames() if (frame.confidence > LOST).any()]
    of_user = [
        [datagram(frame, user) for frame in islice(cycle(frames), user * APART, user * APART + len(frames))]
        for user in range(1, users + 1)
    ]
    return [list(together) for together in zip(*of_user, strict=True)]
