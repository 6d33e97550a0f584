"""The sound that a live service hears: the channel ``voice`` of its performers, and the sound beside a take."""

import time
import wave
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from capture.sound import BLOCK_SECONDS, Block, ClockedSound, Microphone, WavWriter, read_wav
from capture.voice import Voice
from puppetline.errors import SourceError

MISSING_SECONDS = 0.5
"""Time without samples after which mouths close, in seconds."""


class SoundSource(Protocol):
    """A microphone, or a file in its place.

    Attributes
    ----------
    rate : int
        Samples per second.
    """

    rate: int

    def blocks(self) -> Iterator[Block]:
        """Yield the blocks that have arrived."""

    def close(self) -> None:
        """Release it."""


class SoundFile:
    """A .wav that is heard once, as if a microphone heard it now; then there is silence.

    Raises
    ------
    SourceError
        It cannot be read.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._samples, self.rate = read_wav(path)
        except (OSError, EOFError, wave.Error) as error:
            raise SourceError(
                f"sound {str(path)!r}",
                found=f"a file that cannot be read ({getattr(error, 'strerror', None) or error})",
                expected="a .wav of 16 bits and one channel",
                fix="Check the path, or convert the file: ffmpeg -i FILE -ac 1 -c:a pcm_s16le OUT.wav",
            ) from error
        self._began, self._next = time.monotonic(), 0
        self._size = round(BLOCK_SECONDS * self.rate)

    def blocks(self) -> Iterator[Block]:
        """Yield the blocks that are over by now."""
        now = time.monotonic()
        while (end := self._next + self._size) <= (now - self._began) * self.rate:
            heard = np.zeros(self._size, np.float32)
            samples = self._samples[self._next : end]
            heard[: len(samples)] = samples
            yield Block(self._began + self._next / self.rate, heard)
            self._next = end

    def close(self) -> None:
        """Do nothing: the file is not open."""


class SoundInput:
    """Follows the loudness of a sound, and writes it beside a take.

    Parameters
    ----------
    source : SoundSource
    """

    def __init__(self, source: SoundSource) -> None:
        self.source = source
        self._voice, self._value, self._heard = Voice(source.rate), 0.0, time.monotonic()
        self._clocked = ClockedSound(source.rate)
        self._writer: WavWriter | None = None

    @property
    def voice(self) -> float:
        """The channel now; 0 if no sound arrives any more."""
        return self._value if time.monotonic() - self._heard < MISSING_SECONDS else 0.0

    @property
    def start(self) -> float | None:
        """Time of the first sample beside the take, in seconds of `time.monotonic`; None before it."""
        return None if self._writer is None else self._clocked.start

    def take_in(self) -> None:
        """Process the sound that has arrived.

        Raises
        ------
        OutputError
            It cannot be written; it is heard nevertheless, and not written any more.
        """
        for block in self.source.blocks():
            self._heard = time.monotonic()
            values = self._voice.add(block.samples)
            if len(values):
                self._value = float(values[-1])
            if self._writer is not None:
                self._write(block)

    def record(self, path: Path) -> None:
        """Write the sound from now on.

        Raises
        ------
        OutputError
        """
        self._clocked, self._writer = ClockedSound(self.source.rate), WavWriter(path, self.source.rate)

    def stop(self) -> Path | None:
        """End the sound beside a take, and return its file; None without one."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()
        return None if writer is None else writer.path

    def close(self) -> None:
        """Release the microphone."""
        self.stop()
        self.source.close()

    def _write(self, block: Block) -> None:
        assert self._writer is not None  # noqa: S101 - checked by the caller
        try:
            self._writer.write(self._clocked.add(block))
        except BaseException:
            self._writer = None
            raise


def open_sound(name: str, folder: Path) -> SoundInput:
    """Open ``"default"``, the system's microphone, or a device by name or number, or a .wav relative to a folder.

    Raises
    ------
    SourceError
    """
    if name.lower().endswith(".wav"):
        return SoundInput(SoundFile(folder / name))
    return SoundInput(Microphone(None if name == "default" else name))
