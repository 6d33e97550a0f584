"""Measure what tracking faces and hands costs: python -m benchmarks.faces_and_hands VIDEO.

This requires the extra `camera`, and a video of one performer. Images are decoded before, and each is tracked by all
trackers in turn, so that all of them see the same machine.
"""

import argparse
import time
from contextlib import closing
from pathlib import Path

import numpy as np

from capture.sensors.camera import Options, Video
from capture.trackers.mediapipe import MediaPipePose
from puppetline.errors import SourceError

KINDS = {
    "body": {},
    "body and face": {"face": True},
    "body and hands": {"hands": True},
    "body, face and hands": {"face": True, "hands": True},
}
WARM_UP = 10
"""Number of images that are not counted."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("video", type=Path)
    path = parser.parse_args().video
    pictures = []
    with closing(Video(f"video:{path}", path, Options(str(path)))) as video:
        try:
            while True:
                pictures.append(video.read(1.0))
        except SourceError:  # the end
            pass
    trackers = {kind: MediaPipePose(**options) for kind, options in KINDS.items()}
    seconds, processor = ({kind: [] for kind in KINDS} for _ in range(2))
    for picture in pictures:
        for kind, tracker in trackers.items():
            start, used = time.perf_counter(), time.process_time()
            tracker.track(picture)
            seconds[kind].append(time.perf_counter() - start)
            processor[kind].append(time.process_time() - used)
    print(f"{len(pictures)} images of {pictures[0].lens.width}×{pictures[0].lens.height} pixels\n")
    print("| tracked | processor time per image, mean | images per second, one after another |\n| --- | --- | --- |")
    for kind, tracker in trackers.items():
        tracker.close()
        cost, rate = 1000 * np.mean(processor[kind][WARM_UP:]), 1 / np.mean(seconds[kind][WARM_UP:])
        print(f"| {kind} | {cost:.1f} ms | {rate:.1f} |")


if __name__ == "__main__":
    main()
