"""Sound beside a take: a .wav on the take's clock, which is readable after a crash.

Clocks of sound cards differ from the computer's by up to some hundred parts per million, which is 60 ms in ten minutes.
So each block of samples comes with the time of its first sample on the computer's clock, and `ClockedSound` resamples
them to follow that clock.
"""

import queue
import wave
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from puppetline import clock
from puppetline.errors import SourceError
from puppetline.files import append_error

ENDING = ".wav"
"""Ending of the sound beside a take, which has the take's name."""

SAMPLE_RATE = 48_000
"""Samples per second of recorded sound."""

FOLLOWING_SECONDS = 20.0
"""Time constant with which recorded sound follows the clock: jitter of the times changes the pitch by little."""

MAX_OFFSET_SECONDS = 0.1
"""Offset from the clock above which samples are missing, such as after an overflow; silence fills the gap."""

BLOCK_SECONDS = 0.02
"""Length of the blocks that a microphone delivers."""

_MAX_BYTES = 2**32 - 1 - 44  # the header takes 44


class Block(NamedTuple):
    """Samples of a microphone.

    Attributes
    ----------
    time : float
        Time of the first sample, in seconds on the monotonic clock.
    samples : (n,) float32
        Within [-1, 1].
    """

    time: float
    samples: NDArray[np.float32]


class ClockedSound:
    """Resamples blocks so that sample k is at the time of the first sample plus k / rate.

    The speed follows the offset between the blocks' times and the samples so far, with `FOLLOWING_SECONDS`, so that a
    constant drift leaves a constant offset: 100 parts per million leave 2 ms.

    Parameters
    ----------
    rate : int
        Samples per second.
    """

    def __init__(self, rate: int = SAMPLE_RATE) -> None:
        self.rate = rate
        self.start: float | None = None
        """Time of the first sample; None before it."""
        self._written = 0
        self._left = np.zeros(0, np.float32)
        self._place = 0.0  # in the samples that are left, of the next one to write

    def add(self, block: Block) -> NDArray[np.float32]:
        """Return the next samples (n,) float32."""
        if not len(block.samples):
            return np.zeros(0, np.float32)
        if self.start is None:
            self.start = block.time
        waiting = len(self._left) - self._place
        offset = (block.time - self.start) * self.rate - self._written - waiting
        gap = np.zeros(0, np.float32)
        if offset > MAX_OFFSET_SECONDS * self.rate:
            gap = np.zeros(round(offset), np.float32)
            offset = 0.0
        speed = 1 - min(max(offset / self.rate, -MAX_OFFSET_SECONDS), MAX_OFFSET_SECONDS) / FOLLOWING_SECONDS
        self._left = np.concatenate([self._left, gap, block.samples])
        places = np.arange(self._place, len(self._left) - 1, speed)
        made = np.interp(places, np.arange(len(self._left)), self._left).astype(np.float32)
        self._place = float(places[-1]) + speed if len(places) else self._place
        kept = min(int(self._place), len(self._left))
        self._left, self._place = self._left[kept:], self._place - kept
        self._written += len(made)
        return made


def read_wav(path: Path) -> tuple[NDArray[np.float32], int]:
    """Return the samples (n,) of a .wav of 16 bits and one channel, and their number per second.

    Raises
    ------
    OSError, EOFError, wave.Error
        The file cannot be read, or is another kind of file.
    """
    with wave.open(str(path)) as file:
        if (file.getsampwidth(), file.getnchannels()) != (2, 1):
            raise wave.Error("not 16 bits and one channel")
        samples = np.frombuffer(file.readframes(file.getnframes()), "<i2")
        return samples.astype(np.float32) / np.float32(32768), file.getframerate()


def is_wav(path: Path) -> bool:
    """Return whether `read_wav` can read a file."""
    try:
        with wave.open(str(path)) as file:
            return (file.getsampwidth(), file.getnchannels()) == (2, 1)
    except (OSError, EOFError, wave.Error):
        return False


class WavWriter:
    """Appends samples to a .wav of 16 bits and one channel; the file is readable at any time.

    Raises
    ------
    OutputError
        The file cannot be written.
    """

    def __init__(self, path: Path, rate: int = SAMPLE_RATE) -> None:
        self.path, self.rate = path, rate
        self._bytes = 0
        try:
            self._file = path.open("wb", buffering=0)
            self._sound: wave.Wave_write = wave.open(self._file)  # noqa: SIM115 - closed with it
            self._sound.setparams((1, 2, rate, 0, "NONE", ""))
            self._sound.writeframes(b"")  # the header
        except OSError as error:
            raise append_error(path, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def seconds(self) -> float:
        """Length of the sound."""
        return self._bytes / 2 / self.rate

    def write(self, samples: NDArray[np.float32]) -> None:
        """Append samples (n,) within [-1, 1].

        Raises
        ------
        OutputError
            The disk is full, or the file has reached its maximum length of 12 hours.
        """
        data = np.rint(np.clip(samples, -1, 1) * 32767).astype("<i2").tobytes()
        if self._bytes + len(data) > _MAX_BYTES:
            raise append_error(self.path, OSError(0, "it has reached its maximum length"))
        try:
            self._sound.writeframes(data)  # and their number in the header
            self._bytes += len(data)
        except OSError as error:
            self.close()
            raise append_error(self.path, error) from error

    def close(self) -> None:
        """Close the file. Closing again does nothing."""
        if not self._file.closed:
            with self._file, suppress(OSError):  # the length in the header is up to date
                self._sound.close()


class Microphone:
    """A microphone that the extra ``sound`` reads.

    Parameters
    ----------
    device : str, optional
        Name or number of the device; the system's default one otherwise.

    Attributes
    ----------
    rate : int
        Samples per second.
    overflows : int
        Number of times that samples were not read in time.

    Raises
    ------
    SourceError
        The extra is not installed, or there is no such microphone.
    """

    rate = SAMPLE_RATE
    _open = 0  # microphones of this process

    def __init__(self, device: str | None = None) -> None:
        try:
            import sounddevice
        except (ImportError, OSError) as error:  # OSError: PortAudio is missing
            raise SourceError(
                "sound",
                found=f"no library for microphones ({error})",
                expected="the extra sound",
                fix="Install it: pip install 'puppetline[sound]'. On Debian, also: apt install libportaudio2",
            ) from error
        self._blocks: queue.SimpleQueue[Block] = queue.SimpleQueue()
        self.overflows = 0
        try:
            if not Microphone._open:  # PortAudio lists devices once; this ends all of its streams
                sounddevice._terminate()
                sounddevice._initialize()
            self._stream: Any = sounddevice.InputStream(
                samplerate=SAMPLE_RATE,
                channels=1,
                dtype="float32",
                device=int(device) if device is not None and device.isdigit() else device,
                blocksize=round(BLOCK_SECONDS * SAMPLE_RATE),
                callback=self._arrived,
            )
            self._stream.start()
        except (sounddevice.PortAudioError, ValueError) as error:
            raise SourceError(
                "sound" if device is None else f"sound {device!r}",
                found=f"a microphone that cannot be opened ({error})",
                expected="a microphone that no other program uses",
                fix="Plug one in, or choose another one.",
            ) from error
        Microphone._open += 1

    def blocks(self) -> Iterator[Block]:
        """Yield the blocks that have arrived."""
        while not self._blocks.empty():
            yield self._blocks.get()

    def close(self) -> None:
        """Release the microphone. Closing again does nothing."""
        if not self._stream.closed:
            Microphone._open -= 1
            self._stream.close()

    def _arrived(self, samples: NDArray[np.float32], _count: int, times: Any, status: Any) -> None:
        self.overflows += bool(status.input_overflow)
        ago = max(times.currentTime - times.inputBufferAdcTime, 0.0)
        self._blocks.put(Block(clock.now() - ago, samples[:, 0].copy()))
