"""Videos as recordings: a tracker finds the performer in every image."""

import math
from contextlib import closing
from pathlib import Path

from capture import native_output
from capture.clip import SkeletonClip
from capture.formats import read_log
from capture.formats.clips import clips_by_performer
from capture.formats.kinds import is_video
from capture.formats.options import ReadOptions
from capture.skeleton import SkeletonFrame


def read_recording(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read a recording of joints, or find the performers of a video; one clip per performer.

    Tracking takes some 30 ms per image. If a video is used often, a take of it (source ``video:``) saves that time.

    Raises
    ------
    SkeletonLogError
        The file is neither, or no performer is in view; see `capture.formats.read_log`.
    SourceError
        OpenCV or MediaPipe is missing, or the video has no images.
    """
    if not is_video(path):
        return read_log(path, options)
    # only videos need these, which load for a second
    from capture.sensors.camera import Options, Video
    from capture.trackers.mediapipe import MediaPipePose

    settings = Options(str(path))
    frames: list[SkeletonFrame] = []
    last = -math.inf
    with (
        native_output.logged(),
        closing(Video(str(path), path, settings)) as video,
        closing(MediaPipePose(settings.height)) as tracker,
    ):
        for picture in video.pictures():
            last = max(picture.time, math.nextafter(last, math.inf))
            frames += [person.frame(last) for person in tracker.track(picture)]
    return clips_by_performer(path, "video", frames)
