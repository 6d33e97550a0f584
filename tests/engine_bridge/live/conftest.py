"""A small character on a stage of its own, and a performer for it."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES

from capture.skeleton import SkeletonFrame
from engine_bridge.live.frame import StreamedCharacter
from engine_bridge.live.role import Manner, Role
from engine_bridge.live.stage import Direction, Stage


@pytest.fixture(scope="session")
def executor():
    with ThreadPoolExecutor(2) as pool:
        yield pool


@pytest.fixture
def make_role(blob_rig, executor):
    """Give the small figure a role."""

    def make(name="dog", manner=Manner(), idle=None, rig=blob_rig):
        return Role(StreamedCharacter(name, rig, 1), manner, executor, idle)

    return make


@pytest.fixture
def make_stage(make_role):
    """Make a stage of some characters of the same figure."""

    def make(names=("dog",), manner=Manner(), direction=Direction(), **more):
        return Stage("stage", [make_role(name, manner, **more) for name in names], direction)

    return make


@pytest.fixture(scope="session")
def kung_fu():
    """The frames of an example performance: somebody stands still for a second, then walks."""
    return tuple(PERFORMANCES["kung_fu"]().frames())


@pytest.fixture(scope="session")
def moved():
    """Return a frame at another time, of another user, elsewhere."""

    def move(frame, time=None, user=None, by=(0.0, 0.0, 0.0)):
        return SkeletonFrame(
            frame.time if time is None else time,
            frame.user if user is None else user,
            frame.positions + np.array(by),
            frame.confidence,
        )

    return move
