"""What a frame of a character shows, beside its number and time."""

from typing import NamedTuple

from capture.skeleton import SkeletonFrame
from engine_bridge.performance.channels import Channels
from engine_bridge.performance.pose import TargetPose
from engine_bridge.service.states import State


class Appearance(NamedTuple):
    """What a frame shows: a target before channels move it, these channels, one of `states.STATES`, the performer."""

    target: TargetPose
    channels: Channels
    state: State
    user: int | None = None
    seen: SkeletonFrame | None = None
