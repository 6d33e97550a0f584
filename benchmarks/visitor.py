"""A recording of a visitor of a kiosk: steps in, raises both hands, moves, raises them again, and leaves."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from puppetline.examples.performances import PERFORMANCES

from capture.recording import Recorder
from capture.skeleton import JOINT_INDEX, SkeletonFrame

FPS = 30

STANDING, SIGNAL, DANCE, AWAY = 3.0, 2.6, 6.0, 6.0
"""Seconds for which the visitor stands still, holds the hands up, moves, and is away."""

COUNT_IN = 3.0
"""Seconds of the kiosk's count."""


def write_visitor(path: Path, dance: float = DANCE, away: float = AWAY) -> float:
    """Write the recording; return its length in seconds, at the end of which the visitor has been away."""
    with_events = Recorder(path)
    end = 0.0
    for frame in visitor(dance):
        with_events.write(frame)
        end = frame.time
    last = replace(frame, user=99, time=end + away, confidence=np.zeros_like(frame.confidence))
    with_events.write(last)
    with_events.close()
    return end + away


def visitor(dance: float) -> Iterator[SkeletonFrame]:
    """Yield the frames of a visitor."""
    moves = list(PERFORMANCES["kung_fu"]().frames())
    first, time = moves[0], 0.0
    still = [first.positions] * round(FPS * STANDING)
    raised = [_hands_up(first.positions, level) for level in _held(SIGNAL)]
    pause = [first.positions] * round(FPS * (COUNT_IN + 0.3))
    moving = [moves[k % len(moves)].positions for k in range(round(FPS * dance))]
    for positions in (*still, *raised, *pause, *moving, *raised, *still):
        yield replace(first, time=time, positions=positions)
        time += 1 / FPS


def _held(seconds: float) -> NDArray[np.float64]:
    """Return how far the hands are raised in each frame, from 0 to 1."""
    rise = np.linspace(0, 1, FPS // 3)
    return np.concatenate([rise, np.ones(round(FPS * seconds)), rise[::-1]])


def _hands_up(positions: NDArray[np.float64], level: float) -> NDArray[np.float64]:
    """Return a pose with both arms turned upwards about the shoulders."""
    raised = positions.copy()
    for side in ("left", "right"):
        shoulder = positions[JOINT_INDEX[f"shoulder_{side}"]]
        chain = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("elbow", "wrist", "hand")]
        lengths = np.cumsum(
            np.linalg.norm(np.diff(positions[[JOINT_INDEX[f"shoulder_{side}"], *chain]], axis=0), axis=1)
        )
        angle = np.pi * level
        outwards = np.sign(shoulder[0] - positions[JOINT_INDEX["shoulder_center"], 0])
        direction = np.array([np.sin(angle) * outwards + 0.15 * outwards, -np.cos(angle), 0.0])
        raised[chain] = shoulder + lengths[:, None] * direction / np.linalg.norm(direction)
    return raised
