"""Measure sensors and the tracker on a rendered performer whose joints are known: the tables of docs/sensors.md.

python -m benchmarks.sensors [--json FILE]

This requires the extra `camera`, and takes two minutes on an otherwise idle machine. FILE gets all values.
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
from capture.sensor_pose import SensorPose
from capture.sensors.source import SensorSource
from capture.skeleton import JOINT_INDEX, SkeletonFrame
from capture.smoothing import FRAMES_PER_SECOND, JointFilter, Smoothing
from capture.trackers.mediapipe import MediaPipePose
from capture.trackers.picture import Person, Picture
from capture.trackers.placing import BodyPlacer
from engine_bridge.character import examples
from engine_bridge.performance.character_motion import make_deformer
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.retargeting import Retargeting
from tests.capture.fusion.virtual_sensors import VirtualSensor, truth, turning

Floats = NDArray[np.float64]

PLACES = [(distance, angle) for distance in (1.5, 2.5, 3.5) for angle in (0.0, 45.0)]
WAVE = slice(99, 144)
"""Frames of the bundled walk in which the performer stands and waves: 1.5 s."""
STILL_FRAMES, SWING_FRAMES = 60, 90
"""Numbers of frames for the measurements of jitter and lag."""
SWING_DEGREES = 40.0
"""Angle by which the forearm swings to either side, once per second."""
WRIST = JOINT_INDEX["wrist_right"]
CUTOFF, BETA = 1.0, 10.0
"""Cutoff frequency of the 1€ filter at rest, in Hz, and its increase in Hz per metre per second."""
IMAGE_PERIOD_SECONDS, IMAGE_COUNT = 0.02, 300
"""Period and number of the images whose latency is measured."""
LISTEN_SECONDS = 8.0
"""How long the frames of the service are counted, in seconds."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE")
    output = parser.parse_args().json
    body, walk = Body(), clean("walk").positions
    found: dict[str, Any] = {"load": os.getloadavg()[0]}
    print(f"load before: {found['load']:.1f} on {os.cpu_count()} processors\n")
    found["errors"] = list(_show(_error_lines(errors(body, walk[WAVE]))))
    found["filters"] = list(_show(_filter_lines(jitter_and_lag(body, walk[0]))))
    with tempfile.TemporaryDirectory() as folder:
        puppet = examples.prepare("human", Path(folder))[1]
        goals = [*fusion(), *latency(puppet, body, walk), _image_rate(puppet, body, walk[WAVE])]
    print("| what | goal | measured | |\n| --- | --- | --- | --- |")
    for goal in goals:
        print(goal.line())
    found["goals"] = {goal.what: goal.value for goal in goals}
    if output is not None:
        output.write_text(json.dumps(found, indent=2), encoding="utf-8")


def errors(body: Body, poses: Floats) -> Iterator[dict[str, Any]]:
    """Yield the errors of joints with and without depth, for each position of the performer."""
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
    """Return the median error in centimetres that remains if the joints of an image are moved as a whole."""
    off = np.where(shown[..., None], off, np.nan)
    return float(np.nanmedian(np.linalg.norm(off - np.nanmedian(off, axis=1, keepdims=True), axis=2)))


def tracked(pictures: list[Picture], depth: bool) -> Floats:
    """Return the joints (T, 20, 3) that MediaPipe finds; NaN without a performer."""
    tracker = MediaPipePose(HEIGHT)
    found = np.full((len(pictures), 20, 3), np.nan)
    for k, each in enumerate(pictures):
        for person in tracker.track(each if depth else Picture(each.time, each.lens, each.color, None)):
            found[k] = person.positions
    tracker.close()
    return found


def jitter_and_lag(body: Body, rest: Floats) -> Iterator[dict[str, Any]]:
    """Yield jitter and lag with and without depth, unfiltered and after each filter."""
    studio = Studio(body, 2.5, 0.0, seed=2)
    poses = [*[rest] * STILL_FRAMES, *(_swung(rest, k / FRAMES_PER_SECOND) for k in range(SWING_FRAMES))]
    shots = [studio.shoot(k / FRAMES_PER_SECOND, pose) for k, pose in enumerate(poses)]
    true = np.array([shot.joints[NAMES.index("wrist_right"), 0] for shot in shots])
    kinds = {"depth": True, "height": False}
    found = {kind: tracked([shot.picture for shot in shots], depth) for kind, depth in kinds.items()}
    for name, smooth in _filters():
        figures = {}
        for kind, positions in found.items():
            still, swing = smooth(positions[:STILL_FRAMES]), smooth(positions[STILL_FRAMES:])
            figures[kind] = {"jitter": _jitter(still[15:]), "lag": _lag(true[STILL_FRAMES:], swing[:, WRIST, 0])}
        yield {"filter": name, **figures}


def _swung(rest: Floats, moment: float) -> Floats:
    """Return a pose with the right upper arm held out and the forearm swinging above it."""
    pose = rest.copy()
    shoulder, elbow = (JOINT_INDEX[f"{name}_right"] for name in ("shoulder", "elbow"))
    angle = np.radians(SWING_DEGREES) * np.sin(2 * np.pi * moment)
    pose[elbow] = pose[shoulder] + [0.26, 0.0, 0.0]
    pose[WRIST] = pose[elbow] + 0.25 * np.array([np.sin(angle), np.cos(angle), 0.0])
    return pose


def _jitter(positions: Floats) -> float:
    """Return the root mean square distance to the mean position of a joint, in millimetres."""
    return 1000 * float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=2).mean()))


def _lag(true: Floats, seen: Floats) -> float:
    """Return the delay of a motion that correlates best with the measured one after the first second, in ms."""
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
    """Smooth by the 1€ filter (G. Casiez, N. Roussel, D. Vogel 2012), for each coordinate separately.

    Parameters
    ----------
    positions : (T, ...) float64
        Metres, at `FRAMES_PER_SECOND`.
    """

    def share(frequency: Any) -> Any:
        return 1 / (1 + FRAMES_PER_SECOND / (2 * np.pi * frequency))

    smooth, speed = [positions[0]], np.zeros_like(positions[0])
    for before, now in pairwise(positions):
        speed = speed + share(CUTOFF) * ((now - before) * FRAMES_PER_SECOND - speed)
        smooth.append(smooth[-1] + share(CUTOFF + BETA * np.abs(speed)) * (now - smooth[-1]))
    return np.stack(smooth)


def fusion() -> Iterator[Goal]:
    """Yield the mean error of the joints of a turning performer, for two virtual sensors and for the better one."""
    turn = turning(clean("walk"), 2.0, 7.0)
    poses = [SensorPose(np.eye(3), np.zeros(3)), SensorPose.of_degrees(4.0, -75.0, 2.0, np.array([2.4, 0.3, 1.9]))]
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
        unswapped = [VirtualSensor(pose, seed=seed + k, swaps=False).record(turn) for k, pose in enumerate(poses)]
        better.append(
            min(_turn_error(turn, c.times, p.apply(c.positions)) for p, c in zip(poses, unswapped, strict=True))
        )
    error, alone = median(both), median(better)
    yield Goal(f"two sensors fused, in a turn (the better one alone: {alone:.1f} cm)", error, round(alone, 1), "cm")


def _rows(clip: Any) -> Iterator[tuple[float, Floats, NDArray[np.float32]]]:
    return zip(clip.times.tolist(), clip.positions, clip.confidence, strict=True)


def _turn_error(turn: Any, times: Floats, positions: Floats) -> float:
    during = (times > 2.0) & (times < 7.0)
    return 100 * float(np.linalg.norm(positions - truth(turn, times), axis=2)[during].mean())


class RepeatedImage:
    """A device that delivers the same image repeatedly."""

    name = "a repeated image"

    def __init__(self, picture: Picture) -> None:
        self._picture = picture
        self.given = 0
        self.late: list[float] = []  # seconds by which a sleep was too long

    def read(self, timeout: float) -> Picture | None:
        if self.given == IMAGE_COUNT:
            time.sleep(timeout)
            return None
        due = time.monotonic() + IMAGE_PERIOD_SECONDS
        time.sleep(IMAGE_PERIOD_SECONDS)
        now = time.monotonic()
        self.given += 1
        self.late.append(now - due)
        return Picture(now, LENS, self._picture.color, self._picture.depth)

    def close(self) -> None:
        pass


class KnownJoints:
    """A tracker that returns known joints without computation, and places them."""

    name = "known joints"

    def __init__(self, joints: Floats) -> None:
        self._pixels, self._posture = LENS.project(joints), joints - joints[0]
        self._placing = BodyPlacer(HEIGHT)

    def track(self, picture: Picture) -> list[Person]:
        sure = np.ones(20, np.float32)
        placed = self._placing.place(picture.time, LENS, self._pixels, self._posture, sure, picture.depth)
        return [] if placed is None else [Person(1, placed[0].astype(np.float32), placed[1])]

    def close(self) -> None:
        pass


def latency(puppet: Path, body: Body, walk: Floats) -> Iterator[Goal]:
    """Yield the time from an image to filtered joints and the handles' targets, without MediaPipe."""
    prepared = load_prepared(puppet)
    shot = Studio(body, 2.5, 0.0, seed=3).shoot(0.0, walk[0])
    joints = tracked([shot.picture] * 5, depth=True)[-1]
    retargeting = Retargeting(prepared.puppet, prepared.mesh, make_deformer(prepared), joints)
    device = RepeatedImage(shot.picture)
    source = SensorSource("benchmark:", lambda: device, lambda _: KnownJoints(joints))
    taken = []
    while device.given < IMAGE_COUNT:
        select([source.fileno()], [], [], 1.0)
        for event in source.receive():
            if isinstance(event, SkeletonFrame):
                retargeting.step(event)
                taken.append(time.monotonic() - event.time)
    source.close()
    milliseconds = 1000 * np.array(taken[IMAGE_COUNT // 10 :])
    yield Goal("from an image to filtered joints, without MediaPipe, median", float(np.median(milliseconds)), 3, "ms")
    sleep_delay = 1000 * np.percentile(device.late, 99)
    yield Goal(
        f"… 99th percentile (delay of a sleep alone: {sleep_delay:.1f} ms)",
        float(np.percentile(milliseconds, 99)),
        3,
        "ms",
    )


def _image_rate(puppet: Path, body: Body, poses: Floats) -> Goal:
    """Return the rate at which the whole service moves a character by images of a video."""
    folder = puppet.parent
    video = cv2.VideoWriter(str(folder / "video.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 60.0, (LENS.width, LENS.height))
    studio = Studio(body, 2.5, 0.0, seed=4)
    for pose in [*poses, *poses[::-1]]:
        video.write(cv2.cvtColor(studio.shoot(0.0, pose).picture.color, cv2.COLOR_RGB2BGR))
    video.release()
    source = f"video:{folder / 'video.mp4'}?height={HEIGHT}&loop"
    lines = ["announce = false", "[network]", "port = 0", "[[stage]]", f"source = {json.dumps(source)}"]
    lines += ['calibrate = "at_once"', "[[stage.character]]", 'name = "human"', f"puppet = {json.dumps(str(puppet))}"]
    with serving(folder / "service", "\n".join(lines)) as service:
        time.sleep(3.0)
        command = [
            sys.executable,
            "-m",
            "puppetline",
            "listen",
            service.stream,
            "--json",
            "--seconds",
            f"{LISTEN_SECONDS:g}",
        ]
        heard = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    [controls] = heard["heard"]
    return Goal(
        "images per second that move a character, of a video of 640×480 at 60 per second",
        controls["rate"],
        25,
        "/s",
        least=True,
    )


def _error_lines(rows: Iterator[dict[str, Any]]) -> Iterator[tuple[str, Any]]:
    yield "| performer at | joints in the image | with depth | … the posture | with the height | … the posture |", None
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
    """Print lines; yield their values."""
    for line, figures in lines:
        print(line, flush=True)
        if figures is not None:
            yield figures
    print()


if __name__ == "__main__":
    main()
