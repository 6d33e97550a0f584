"""What goes with a film that is shared: a poster, and a .gif for programs that play no videos."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from engine_bridge.film.av_library import require_av
from engine_bridge.film.film import GIF_FPS, GIF_WIDTH, PALETTE_FRAMES
from engine_bridge.film.scene import load
from engine_bridge.film.video import VideoWriter
from puppetline.files import check_new, check_writable, written_whole

POSTER_SHARE = 1 / 3
"""Share of the film's time after which its poster is taken."""

GIF_SECONDS = 15.0
"""Maximum length of the .gif in seconds; it holds the beginning of the film."""

POSTER_QUALITY = 88
"""Quality of the poster, of 100."""


def check_sharing(video: Path, scene: Path, replace: bool) -> None:
    """Check before the film is made that what goes with it can be written.

    Parameters
    ----------
    video, scene : Path
    replace : bool
        Whether existing files are replaced; the picture in the background of the scene is not.

    Raises
    ------
    PuppetlineError
        The scene file has an error, or a file cannot be written, exists, or belongs to the scene.
    """
    picture = load(scene).background.picture
    inputs = [] if picture is None else [scene.parent / picture]
    for ending in (".jpg", ".gif"):
        path = video.with_suffix(ending)
        check_writable(path, ending, inputs)
        if not replace:
            check_new(path, "Choose another name with -o, or replace it with --force.")


def share_video(video: Path) -> None:
    """Write a poster (.jpg) and a .gif beside a video.

    Raises
    ------
    PuppetlineError
        The extra ``film`` is missing, or a file cannot be written.
    """
    with require_av().open(str(video)) as container:
        stream = container.streams.video[0]
        fps = float(stream.average_rate)
        seconds, last = stream.frames / fps, (stream.frames - 1) / fps
        width = min(stream.width, GIF_WIDTH)
        size = width, max(2 * round(stream.height * width / stream.width / 2), 2)
    with written_whole(video.with_suffix(".jpg")) as beside:
        next(_frames(video, min(POSTER_SHARE * seconds, last))).to_image().save(beside, quality=POSTER_QUALITY)
    length = min(seconds, GIF_SECONDS)
    samples = [_pixels(each, size) for each in islice(_frames(video, 0.0, length / PALETTE_FRAMES), PALETTE_FRAMES)]
    with (
        written_whole(video.with_suffix(".gif")) as beside,
        VideoWriter(beside, size, GIF_FPS, samples=samples) as writer,
    ):
        for frame in islice(_frames(video, 0.0, 1 / GIF_FPS), max(1, round(length * GIF_FPS))):
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
