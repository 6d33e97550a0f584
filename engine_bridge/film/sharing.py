"""What goes with a film that is shared: a poster, and a .gif for programs that play no videos."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from engine_bridge.film.av_library import require_av
from engine_bridge.film.film import GIF_FPS, GIF_WIDTH, PALETTE_FRAMES
from engine_bridge.film.video import VideoWriter
from puppetline.files import written_whole

POSTER_SHARE = 1 / 3
"""Share of the film's time after which its poster is taken."""

GIF_SECONDS = 15.0
"""Maximum length of the .gif in seconds; it holds the beginning of the film."""

POSTER_QUALITY = 88
"""Quality of the poster, of 100."""


def share_video(video: Path) -> None:
    """Write a poster (.jpg) and a .gif beside a video.

    Raises
    ------
    PuppetlineError
        The extra ``film`` is missing, or a file cannot be written.
    """
    with require_av().open(str(video)) as container:
        stream = container.streams.video[0]
        seconds = stream.frames / float(stream.average_rate)
        width = min(stream.width, GIF_WIDTH)
        size = width, 2 * round(stream.height * width / stream.width / 2)
    with written_whole(video.with_suffix(".jpg")) as beside:
        next(_frames(video, POSTER_SHARE * seconds)).to_image().save(beside, quality=POSTER_QUALITY)
    length = min(seconds, GIF_SECONDS)
    samples = [_pixels(each, size) for each in islice(_frames(video, 0.0, length / PALETTE_FRAMES), PALETTE_FRAMES)]
    with (
        written_whole(video.with_suffix(".gif")) as beside,
        VideoWriter(beside, size, GIF_FPS, samples=samples) as writer,
    ):
        for frame in islice(_frames(video, 0.0, 1 / GIF_FPS), round(length * GIF_FPS)):
            writer.add(_pixels(frame, size))


def _frames(video: Path, start: float, interval: float = 0.0) -> Iterator[Any]:
    """Yield the first frame of a video at or after a time in seconds, and then one per interval."""
    with require_av().open(str(video)) as container:
        due = start
        for frame in container.decode(video=0):
            if frame.time >= due - 1e-6:
                yield frame
                due += interval


def _pixels(frame: Any, size: tuple[int, int]) -> Any:
    return frame.to_ndarray(format="rgba", width=size[0], height=size[1])
