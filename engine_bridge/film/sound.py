"""Sound of films: tracks that are decoded, faded and mixed block by block, so that their length does not matter."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.av_library import require_av
from engine_bridge.film.music import piece
from engine_bridge.film.scene import MusicTable, SceneError, SoundTable, check_exists
from puppetline.errors import at

SAMPLE_RATE = 48_000
"""Samples per second of a film's sound, which has two channels."""


class Mixer:
    """The sound of a film, read from its beginning to its end; a file that cannot be played is left out, with a note.

    Parameters
    ----------
    tables : sequence of SoundTable
    scene : Path
        Scene file; names of sound files are relative to it.
    seconds : float
        Length of the film.
    music : MusicTable

    Attributes
    ----------
    peak : float
        Maximum of the samples so far, before they were limited.
    notes : list of str
        Sentences for the user about files.
    """

    def __init__(
        self, tables: Sequence[SoundTable], scene: Path, seconds: float, music: MusicTable | None = None
    ) -> None:
        self.notes, self._tracks = list[str](), list[_Track]()
        for number, table in enumerate(tables, 1):
            if not table.mute:
                with self._noted():
                    blocks, length = decoded(scene.parent / table.file, at(scene, field=f"[[sound]] {number}, file"))
                    self._tracks.append(_Track(table, blocks, seconds if length is None else length, seconds))
        if music is not None and (music.loop or music.file):
            with self._noted():
                table = SoundTable(
                    file=music.file or str(music.loop), gain=music.gain, fade_in=music.fade_in, fade_out=music.fade_out
                )
                self._tracks.append(_Track(table, _repeated(music, scene), seconds, seconds))
        self._position = 0
        self.peak = 0.0

    def __len__(self) -> int:
        """Return the number of tracks."""
        return len(self._tracks)

    def skip(self, count: int) -> None:
        """Drop the next samples."""
        while count > 0:
            count -= len(self.read(min(count, SAMPLE_RATE)))

    @contextmanager
    def _noted(self) -> Iterator[None]:
        """Note an error of a file."""
        try:
            yield
        except SceneError as error:
            self.notes.append(f"A sound is left out. {error}")

    def read(self, count: int) -> NDArray[np.float32]:
        """Return the next samples (count, 2), within [-1, 1]."""
        mixed = np.zeros((count, 2), np.float32)
        for track in self._tracks:
            with self._noted():
                track.add_to(mixed, self._position)
        self._position += count
        self.peak = max(self.peak, float(np.abs(mixed).max(initial=0.0)))
        return np.clip(mixed, -1, 1, out=mixed)


class _Track:
    """A part of a sound file on the film's clock."""

    def __init__(self, table: SoundTable, blocks: Iterator[NDArray[np.float32]], length: float, seconds: float) -> None:
        self._begin = round(table.at * SAMPLE_RATE)
        self._gain = np.float32(10 ** (table.gain / 20))
        self._blocks = blocks
        end = seconds - table.at + table.start
        end = min(end, length, length if table.stop is None else table.stop)
        self._count = max(round((end - table.start) * SAMPLE_RATE), 0)
        self._fades = table.fade_in * SAMPLE_RATE, table.fade_out * SAMPLE_RATE
        self._left = np.zeros((0, 2), np.float32)
        self._skip = round(table.start * SAMPLE_RATE)

    def add_to(self, mixed: NDArray[np.float32], position: int) -> None:
        """Add the samples from a position of the film on; positions follow each other."""
        first, end = max(position, self._begin), min(position + len(mixed), self._begin + self._count)
        if first >= end:
            return
        samples = self._next(end - first)
        numbers = np.arange(first - self._begin, first - self._begin + len(samples))
        share = np.ones(len(samples))
        fade_in, fade_out = self._fades
        if fade_in:
            share *= np.clip(numbers / fade_in, 0, 1)
        if fade_out:
            share *= np.clip((self._count - numbers) / fade_out, 0, 1)
        mixed[first - position : first - position + len(samples)] += (
            samples * (self._gain * share).astype(np.float32)[:, None]
        )

    def _next(self, count: int) -> NDArray[np.float32]:
        """Return the next samples of the file, fewer at its end."""
        while self._skip or len(self._left) < count:
            block = next(self._blocks, None)
            if block is None:
                break
            dropped = min(self._skip, len(block))
            self._skip -= dropped
            self._left = np.concatenate([self._left, block[dropped:]])
        taken, self._left = self._left[:count], self._left[count:]
        return taken


def _repeated(music: MusicTable, scene: Path) -> Iterator[NDArray[np.float32]]:
    """Return the samples of music without end; a file that has none ends at once."""
    if music.loop is not None:
        return repeat(piece(music.loop))
    path, where = scene.parent / str(music.file), at(scene, field="[music], file")
    check_exists(path, where, "a sound file", "remove the key file")
    first, _ = decoded(path, where)

    def blocks() -> Iterator[NDArray[np.float32]]:
        again, heard = first, True
        while heard:
            heard = False
            for block in again:
                heard = heard or len(block) > 0
                yield block
            again, _ = decoded(path, where)

    return blocks()


def decoded(path: Path, where: str) -> tuple[Iterator[NDArray[np.float32]], float | None]:
    """Open a sound file.

    Parameters
    ----------
    path : Path
    where : str
        Place of its name, for errors.

    Returns
    -------
    blocks : iterator of (n, 2) float32
        At `SAMPLE_RATE`, from the file's time 0 on.
    seconds : float or None
        Length, None if the file does not state it.

    Raises
    ------
    SceneError
        The file is missing, or holds no sound; while blocks are read: it is damaged.
    """
    av = require_av()
    check_exists(path, where, "a sound file")
    try:
        container = av.open(str(path))
    except (av.error.FFmpegError, OSError) as error:
        raise _damaged(where, path, error) from error
    if not container.streams.audio:
        raise SceneError(where, found=f"no sound in {path}", expected="a file with sound", fix="Choose another file.")
    stream = container.streams.audio[0]
    seconds = None
    if stream.duration is not None:
        seconds = float(stream.duration * stream.time_base)
    elif container.duration is not None:
        seconds = container.duration / av.time_base
    return _blocks(container, stream, where, path), seconds


def _blocks(container: Any, stream: Any, where: str, path: Path) -> Iterator[NDArray[np.float32]]:
    av = require_av()
    mono = stream.codec_context.layout.nb_channels == 1  # the library would make it quieter
    resampler = av.AudioResampler(format="flt", layout="mono" if mono else "stereo", rate=SAMPLE_RATE)
    started = False

    def resampled(frame: Any) -> Iterator[NDArray[np.float32]]:
        for block in resampler.resample(frame):
            samples = block.to_ndarray()
            yield samples.T.repeat(2, axis=1) if mono else samples.reshape(-1, 2)

    with container:
        try:
            for frame in container.decode(stream):
                if not started and frame.time is not None:  # such as the sound of a video that begins late
                    silence = frame.time - (container.start_time or 0) / av.time_base
                    yield np.zeros((max(round(silence * SAMPLE_RATE), 0), 2), np.float32)
                started = True
                yield from resampled(frame)
            yield from resampled(None)
        except (av.error.FFmpegError, OSError) as error:
            raise _damaged(where, path, error) from error


def _damaged(where: str, path: Path, error: Exception) -> SceneError:
    return SceneError(
        where,
        found=f"{path}, which cannot be decoded ({getattr(error, 'strerror', None) or error})",
        expected="a sound file, such as .wav, .flac or .mp3",
        fix="Export the sound again, or choose another file.",
    )
