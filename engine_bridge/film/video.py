"""Writing of videos, frame by frame, so that their length does not matter: .mp4, .webm and .gif."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from engine_bridge.film.av_library import require_av
from engine_bridge.film.sound import SAMPLE_RATE

GIF_COLORS = 256
"""Number of colours of a .gif."""


class Format(NamedTuple):
    """Codecs of a kind of video, and the options of the one for pictures; a .gif has no sound."""

    video: str
    pixels: str
    options: dict[str, str]
    sound: str | None


FORMATS = {
    ".mp4": Format(
        "libx264", "yuv420p", {"preset": "superfast", "crf": "19", "x264-params": "mbtree=1:rc-lookahead=10"}, "aac"
    ),
    ".webm": Format(
        "libvpx-vp9",
        "yuv420p",
        {"deadline": "realtime", "cpu-used": "7", "crf": "30", "b": "0", "row-mt": "1"},
        "libopus",
    ),
    ".gif": Format("gif", "pal8", {}, None),
}
"""Kinds of videos by the endings of their files. With a look ahead, x264's superfast needs two thirds of the processor
time of veryfast; the files are 17 % larger and 0.4 dB farther from the frames."""


class VideoWriter:
    """Writes a video.

    Parameters
    ----------
    path : Path
        Its ending is one of `FORMATS`.
    size : tuple of 2 ints
    fps : float
    sound : bool
        Whether frames come with sound.
    samples : sequence of (h, w, 4) uint8
        Frames from which the colours of a .gif are chosen.
    """

    def __init__(
        self,
        path: Path,
        size: tuple[int, int],
        fps: float,
        *,
        sound: bool = False,
        samples: Sequence[NDArray[np.uint8]] = (),
    ) -> None:
        self._av = require_av()
        self._format = FORMATS[path.suffix.lower()]
        options = {"movflags": "+faststart"} if path.suffix.lower() == ".mp4" else {}
        self._container = self._av.open(str(path), "w", options=options)
        rate = Fraction(fps).limit_denominator(1001)
        self._video: Any = self._container.add_stream(self._format.video, rate=rate, options=self._format.options)
        self._video.width, self._video.height = size
        self._video.pix_fmt = self._format.pixels
        self._tick = 1 / rate  # the stream's own time base changes when the file begins
        self._video.codec_context.time_base = self._tick
        if self._format.pixels == "yuv420p":
            context = self._video.codec_context
            context.colorspace = context.color_primaries = context.color_trc = 1  # BT.709
            context.color_range = 1  # 16 to 235
        self._sound: Any = None
        if sound and self._format.sound is not None:
            self._sound = self._container.add_stream(self._format.sound, rate=SAMPLE_RATE, layout="stereo")
        self._frames = self._samples = 0
        if self._format.pixels == "pal8":
            self._palette, self._colors = _palette(samples)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                for stream in filter(None, (self._video, self._sound)):
                    self._container.mux(stream.encode(None))
        finally:
            self._container.close()

    def add(self, pixels: NDArray[np.uint8], sound: NDArray[np.float32] | None = None) -> None:
        """Add a frame (h, w, 4), and the sound (n, 2) during it."""
        if self._format.pixels == "pal8":
            frame = self._indexed(pixels)
        else:
            frame = self._av.VideoFrame.from_ndarray(pixels, format="rgba")
            frame = frame.reformat(
                format=self._format.pixels, dst_colorspace="ITU709", src_color_range="JPEG", dst_color_range="MPEG"
            )
        frame.pts, frame.time_base = self._frames, self._tick
        self._frames += 1
        self._container.mux(self._video.encode(frame))
        if sound is None or self._sound is None or not len(sound):
            return
        block = self._av.AudioFrame.from_ndarray(np.ascontiguousarray(sound.T), format="fltp", layout="stereo")
        block.sample_rate, block.pts, block.time_base = SAMPLE_RATE, self._samples, Fraction(1, SAMPLE_RATE)
        self._samples += len(sound)
        self._container.mux(self._sound.encode(block))

    def _indexed(self, pixels: NDArray[np.uint8]) -> Any:
        """Return a frame in the colours of a .gif, without dithering, which would flicker and multiply the size."""
        image = Image.fromarray(pixels[..., :3]).quantize(palette=self._palette, dither=Image.Dither.NONE)
        return self._av.VideoFrame.from_ndarray((np.asarray(image), self._colors), format="pal8")


def _palette(samples: Sequence[NDArray[np.uint8]]) -> tuple[Image.Image, NDArray[np.uint8]]:
    """Return an image with the colours of some frames, and these colours (256, 4) with an opacity in front."""
    pixels = np.concatenate([sample[::2, ::2, :3].reshape(-1, 3) for sample in samples])
    shades, counts = np.unique(pixels, axis=0, return_counts=True)
    # large backgrounds count less than their pixels, or they would leave no colours for what is small
    weighted = shades.repeat(np.ceil(np.sqrt(counts)).astype(int), axis=0)
    image = Image.fromarray(weighted[None]).quantize(GIF_COLORS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    own = np.array(image.getpalette(), np.uint8).reshape(-1, 3)[:GIF_COLORS]
    colors = np.full((GIF_COLORS, 4), 255, np.uint8)
    colors[: len(own), 1:] = own
    return image, colors
