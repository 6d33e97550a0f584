"""Measure sensors and the tracker on a rendered performer whose joints are known: the tables of docs/sensors.md.

python -m benchmarks.sensors [--json FILE]

Wants the extra `camera`; takes two minutes, twice that where other programs run. FILE has all figures.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from heapq import merge
from itertools import pairwise
from pathlib import Path
from select import select
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from puppetline.examples.performances import clean

from benchmarks.goals import Goal
from benchmarks.live_peers import serving
from benchmarks.rendered_body import HEIGHT, KINECT, LENS, NAMES, Body, Studio
from benchmarks.smoothing import PRESETS
from capture.fusion.performers import Performers
from capture.pose import Pose
from capture.sensors.source import SensorSource
from capture.skeleton import JOINT_INDEX, SkeletonFrame
from capture.smoothing import FRAMES_PER_SECOND, JointFilter, Smoothing
from capture.trackers.mediapipe import MediaPipePose
from capture.trackers.picture import Person, Picture
from capture.trackers.placing import Placing
from engine_bridge.cli import examples
from engine_bridge.performance.performance import make_deformer
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.performance.rig import load_rig
from tests.capture.fusion.conftest import VirtualSensor, truth, turning

Floats = NDArray[np.float64]

PLACES = [(distance, angle) for distance in (1.5, 2.5, 3.5) for angle in (0.0, 45.0)]
WAVE = slice(99, 144)
"""Frames of the bundled walk in which the performer stands and waves: 1.5 s."""
STILL, SWINGS = 60, 90
"""Frames of which jitter and lag are measured."""
SWING = 40.0
"""Degrees to either side by which the forearm swings, once a second."""
WRIST = JOINT_INDEX["wrist_right"]
CUTOFF, BETA = 1.0, 10.0
"""Of the 1€ filter: Hz for what is at rest, and by how many Hz that rises for each metre a second."""
PACE, COUNT = 0.02, 300
"""Seconds between the pictures of which the latency is measured, and how many."""
LISTENED = 8.0
"""Seconds for which the service's frames are counted."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE")
    output = parser.parse_args().json
    body, walk = Body(), clean("walk").positions
    found: dict[str, Any] = {"load": os.getloadavg()[0]}
    print(f"load before it began: {found['load']:.1f} on {os.cpu_count()} processors\n")
    found["errors"] = list(_show(_error_lines(errors(body, walk[WAVE]))))
    found["filters"] = list(_show(_filter_lines(unrest(body, walk[0]))))
    with tempfile.TemporaryDirectory() as folder:
        puppet = examples.prepare("human", Path(folder))[1]
        goals = [*fusion(), *added(puppet, body, walk), _pace(puppet, body, walk[WAVE])]
    print("| what | goal | measured | |\n| --- | --- | --- | --- |")
    for goal in goals:
        print(goal.line())
    found["goals"] = {goal.what: goal.value for goal in goals}
    if output is not None:
        output.write_text(json.dumps(found, indent=2), encoding="utf-8")


def errors(body: Body, poses: Floats) -> Iterator[dict[str, Any]]:
    """Yield how far off joints are, with depth and without, where the performer stands."""
    for distance, angle in PLACES:
        studio = Studio(body, distance, angle, seed=1)
        shots = [studio.shoot(k / FRAMES_PER_SECOND, pose) for k, pose in enumerate(poses)]
        true = np.stack([shot.joints for shot in shots])
        pixels = LENS.project(true)
        shown = ((pixels >= 0) & (pixels < [LENS.width, LENS.height])).all(axis=2)
        figures = {}
        for kind, depth in (("depth", True), ("height", False)):
            off = 100 * (tracked([shot.picture for shot in shots], depth)[:, KINECT] - true)
            size = np.where(shown, np.linalg.norm(off, axis=2), np.nan)
            each = np.nanmedian(size[:, shown.any(axis=0)], axis=0)
            worst = np.array(NAMES)[shown.any(axis=0)][each.argmax()]
            figures[kind] = {"median": np.nanmedian(size), "p95": np.nanpercentile(size, 95), "worst": worst}
            figures[kind] |= {"worst_median": each.max(), "shape": _shape_error(off, shown)}
        yield {"distance": distance, "angle": angle, "shown": int(shown.any(axis=0).sum()), **figures}


def _shape_error(off: Floats, shown: NDArray[np.bool_]) -> float:
    """Return the median error (centimetres) that is left when a picture's joints are moved as a whole."""
    off = np.where(shown[..., None], off, np.nan)
    return float(np.nanmedian(np.linalg.norm(off - np.nanmedian(off, axis=1, keepdims=True), axis=2)))


def tracked(pictures: list[Picture], depth: bool) -> Floats:
    """Return the joints (T, 20, 3) that MediaPipe finds; NaN where nobody was found."""
    tracker = MediaPipePose(HEIGHT)
    found = np.full((len(pictures), 20, 3), np.nan)
    for k, each in enumerate(pictures):
        for person in tracker.track(each if depth else Picture(each.time, each.lens, each.color, None)):
            found[k] = person.positions
    tracker.close()
    return found


def unrest(body: Body, rest: Floats) -> Iterator[dict[str, Any]]:
    """Yield jitter and lag, with depth and without, as tracked and behind each filter."""
    studio = Studio(body, 2.5, 0.0, seed=2)
    poses = [*[rest] * STILL, *(_swung(rest, k / FRAMES_PER_SECOND) for k in range(SWINGS))]
    shots = [studio.shoot(k / FRAMES_PER_SECOND, pose) for k, pose in enumerate(poses)]
    true = np.array([shot.joints[NAMES.index("wrist_right"), 0] for shot in shots])
    kinds = {"depth": True, "height": False}
    found = {kind: tracked([shot.picture for shot in shots], depth) for kind, depth in kinds.items()}
    for name, smooth in _filters():
        figures = {}
        for kind, positions in found.items():
            still, swing = smooth(positions[:STILL]), smooth(positions[STILL:])
            figures[kind] = {"jitter": _jitter(still[15:]), "lag": _lag(true[STILL:], swing[:, WRIST, 0])}
        yield {"filter": name, **figures}


def _swung(rest: Floats, moment: float) -> Floats:
    """Return a pose with the right upper arm held out, its forearm swinging like a pendulum that stands on it."""
    pose = rest.copy()
    shoulder, elbow = (JOINT_INDEX[f"{name}_right"] for name in ("shoulder", "elbow"))
    angle = np.radians(SWING) * np.sin(2 * np.pi * moment)
    pose[elbow] = pose[shoulder] + [0.26, 0.0, 0.0]
    pose[WRIST] = pose[elbow] + 0.25 * np.array([np.sin(angle), np.cos(angle), 0.0])
    return pose


def _jitter(positions: Floats) -> float:
    """Return millimetres, root mean square of the distance to a joint's mean."""
    return 1000 * float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=2).mean()))


def _lag(true: Floats, seen: Floats) -> float:
    """Return the milliseconds by which a motion has to be delayed to be most like what was seen, after a second."""
    times = np.arange(len(true)) / FRAMES_PER_SECOND
    later = np.arange(0.0, 0.4, 0.001)
    after = times >= 1.0
    likeness = [np.corrcoef(np.interp(times - delay, times, true)[after], seen[after])[0, 1] for delay in later]
    return 1000 * float(later[np.argmax(likeness)])


def _filters() -> Iterator[tuple[str, Callable[[Floats], Floats]]]:
    yield "none", lambda positions: positions
    for name, smoothing in PRESETS.items():
        yield name if name == "Puppetline" else f"Kinect SDK, {name}", _behind(smoothing)
    yield f"1€, {CUTOFF:g} Hz, β = {BETA:g} /m", one_euro


def _behind(smoothing: Smoothing) -> Callable[[Floats], Floats]:
    def smooth(positions: Floats) -> Floats:
        joint_filter, sure = JointFilter(smoothing), np.ones(20, np.float32)
        return np.stack([joint_filter.step(k / FRAMES_PER_SECOND, frame, sure) for k, frame in enumerate(positions)])

    return smooth


def one_euro(positions: Floats) -> Floats:
    """Smooth by the 1€ filter (G. Casiez, N. Roussel, D. Vogel 2012), each coordinate by itself.

    Parameters
    ----------
    positions : (T, ...) float64
        Metres, `FRAMES_PER_SECOND` times a second.
    """

    def share(frequency: Any) -> Any:
        return 1 / (1 + FRAMES_PER_SECOND / (2 * np.pi * frequency))

    smooth, speed = [positions[0]], np.zeros_like(positions[0])
    for before, now in pairwise(positions):
        speed = speed + share(CUTOFF) * ((now - before) * FRAMES_PER_SECOND - speed)
        smooth.append(smooth[-1] + share(CUTOFF + BETA * np.abs(speed)) * (now - smooth[-1]))
    return np.stack(smooth)


def fusion() -> Iterator[Goal]:
    """Yield the mean error of the joints of somebody who turns round, of two virtual sensors against the better one."""
    turn = turning(clean("walk"), 2.0, 7.0)
    poses = [Pose(np.eye(3), np.zeros(3)), Pose.of_degrees(4.0, -75.0, 2.0, np.array([2.4, 0.3, 1.9]))]
    both, better = [], []
    for seed in (1, 5, 9):
        sensors = [VirtualSensor(pose, seed=seed + k) for k, pose in enumerate(poses)]
        clips = [sensor.record(turn, phase=0.013 * k) for k, sensor in enumerate(sensors)]
        streams = [
            [(time, k, SkeletonFrame(time, 1, pose.apply(joints), sure)) for time, joints, sure in _rows(clip)]
            for k, (pose, clip) in enumerate(zip(poses, clips, strict=True))
        ]
        performers = Performers()
        seen = [performers.observe(k, frame) for _, k, frame in merge(*streams, key=lambda each: each[:2])]
        frames = [frame for frame in seen if frame is not None]
        both.append(_turn_error(turn, np.array([f.time for f in frames]), np.stack([f.positions for f in frames])))
        told = [VirtualSensor(pose, seed=seed + k, swaps=False).record(turn) for k, pose in enumerate(poses)]
        better.append(min(_turn_error(turn, c.times, p.apply(c.positions)) for p, c in zip(poses, told, strict=True)))
    error, alone = median(both), median(better)
    yield Goal(f"two sensors fused, in a turn (the better one alone: {alone:.1f} cm)", error, round(alone, 1), "cm")


def _rows(clip: Any) -> Iterator[tuple[float, Floats, NDArray[np.float32]]]:
    return zip(clip.times.tolist(), clip.positions, clip.confidence, strict=True)


def _turn_error(turn: Any, times: Floats, positions: Floats) -> float:
    during = (times > 2.0) & (times < 7.0)
    return 100 * float(np.linalg.norm(positions - truth(turn, times), axis=2)[during].mean())


class Reel:
    """A device that gives the same picture again and again."""

    name = "a reel"

    def __init__(self, picture: Picture) -> None:
        self._picture = picture
        self.given = 0
        self.late: list[float] = []  # seconds by which a sleep was too long

    def read(self, timeout: float) -> Picture | None:
        if self.given == COUNT:
            time.sleep(timeout)
            return None
        due = time.monotonic() + PACE
        time.sleep(PACE)
        now = time.monotonic()
        self.given += 1
        self.late.append(now - due)
        return Picture(now, LENS, self._picture.color, self._picture.depth)

    def close(self) -> None:
        pass


class Knowing:
    """A tracker that knows at once what a tracker would find, and places it."""

    name = "a knowing tracker"

    def __init__(self, joints: Floats) -> None:
        self._pixels, self._posture = LENS.project(joints), joints - joints[0]
        self._placing = Placing(HEIGHT)

    def track(self, picture: Picture) -> list[Person]:
        sure = np.ones(20, np.float32)
        placed = self._placing.place(picture.time, LENS, self._pixels, self._posture, sure, picture.depth)
        return [] if placed is None else [Person(1, placed[0].astype(np.float32), placed[1])]

    def close(self) -> None:
        pass


def added(puppet: Path, body: Body, walk: Floats) -> Iterator[Goal]:
    """Yield the time from a picture to filtered joints and the handles' targets, without MediaPipe's."""
    rig = load_rig(puppet)
    shot = Studio(body, 2.5, 0.0, seed=3).shoot(0.0, walk[0])
    joints = tracked([shot.picture] * 5, depth=True)[-1]
    retargeting = Retargeting(rig.puppet, rig.mesh, make_deformer(rig.puppet, rig.mesh, rig.model), joints)
    reel = Reel(shot.picture)
    source = SensorSource("benchmark:", lambda: reel, lambda _: Knowing(joints))
    taken = []
    while reel.given < COUNT:
        select([source.fileno()], [], [], 1.0)
        for event in source.receive():
            if isinstance(event, SkeletonFrame):
                retargeting.step(event)
                taken.append(time.monotonic() - event.time)
    source.close()
    milliseconds = 1000 * np.array(taken[COUNT // 10 :])
    yield Goal("from a picture to filtered joints, MediaPipe excluded, median", float(np.median(milliseconds)), 3, "ms")
    unrest = 1000 * np.percentile(reel.late, 99)
    yield Goal(
        f"… 99th percentile (that of a sleep's delay: {unrest:.1f} ms)", float(np.percentile(milliseconds, 99)), 3, "ms"
    )


def _pace(puppet: Path, body: Body, poses: Floats) -> Goal:
    """Return how many of a film's pictures a second move a character, all of it running."""
    folder = puppet.parent
    film = cv2.VideoWriter(str(folder / "film.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 60.0, (LENS.width, LENS.height))
    studio = Studio(body, 2.5, 0.0, seed=4)
    for pose in [*poses, *poses[::-1]]:
        film.write(cv2.cvtColor(studio.shoot(0.0, pose).picture.color, cv2.COLOR_RGB2BGR))
    film.release()
    source = f"video:{folder / 'film.mp4'}?height={HEIGHT}&loop"
    lines = ["announce = false", "[network]", "port = 0", "[[stage]]", f"source = {json.dumps(source)}"]
    lines += ['calibrate = "at_once"', "[[stage.character]]", 'name = "human"', f"puppet = {json.dumps(str(puppet))}"]
    with serving(folder / "service", "\n".join(lines)) as service:
        time.sleep(3.0)
        command = [sys.executable, "-m", "puppetline", "listen", service.stream, "--json", "--seconds", f"{LISTENED:g}"]
        heard = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    [controls] = heard["heard"]
    return Goal(
        "pictures a second that move a character, of a film of 640×480, 60 a second",
        controls["rate"],
        25,
        "/s",
        least=True,
    )


def _error_lines(rows: Iterator[dict[str, Any]]) -> Iterator[tuple[str, Any]]:
    yield "| stands | joints in the picture | with depth | … the posture | with the height | … the posture |", None
    yield "| --- | --- | --- | --- | --- | --- |", None
    for row in rows:
        cells = [f"{row['distance']:g} m, " + (f"turned by {row['angle']:g}°" if row["angle"] else "facing")]
        cells.append(f"{row['shown']} of {len(NAMES)}")
        for kind in ("depth", "height"):
            own = row[kind]
            worst = f"{own['worst'].replace('_', ' ')} {own['worst_median']:.0f}"
            cells += [f"{own['median']:.1f} (95 %: {own['p95']:.0f}; {worst})", f"{own['shape']:.1f}"]
        yield f"| {' | '.join(cells)} |", row


def _filter_lines(rows: Iterator[dict[str, Any]]) -> Iterator[tuple[str, Any]]:
    yield "| filter | jitter, with depth, mm | lag, ms | jitter, with the height, mm | lag, ms |", None
    yield "| --- | --- | --- | --- | --- |", None
    for row in rows:
        cells = [f"{row[kind]['jitter']:.1f} | {row[kind]['lag']:.0f}" for kind in ("depth", "height")]
        yield f"| {row['filter']} | {' | '.join(cells)} |", row


def _show(lines: Iterator[tuple[str, Any]]) -> Iterator[Any]:
    """Print lines as they come; yield the figures in them."""
    for line, figures in lines:
        print(line, flush=True)
        if figures is not None:
            yield figures
    print()


if __name__ == "__main__":
    main()
