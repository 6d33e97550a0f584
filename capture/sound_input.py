"""The sound that a live service hears: the channel ``voice`` of its performers, and the sound beside a take."""

import logging
import queue
import threading
import wave
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from capture.sound import BLOCK_SECONDS, Block, ClockedSound, Microphone, WavWriter, read_wav
from capture.voice import STEP_SECONDS, Voice
from puppetline import clock
from puppetline.errors import SourceError

MISSING_SECONDS = 0.5
"""Time without samples after which mouths close, in seconds."""

LOST_SECONDS = 3.0
"""Time without samples after which a microphone counts as unplugged, in seconds."""

RETRY_SECONDS = 2.0
"""Interval between attempts to open an unplugged microphone, in seconds."""

KEPT_SECONDS = 2.0
"""Maximum lateness of a frame that gets the voice of its own time, in seconds."""

log = logging.getLogger(__name__)


class SoundSource(Protocol):
    """A microphone, or a file in its place.

    Attributes
    ----------
    rate : int
        Samples per second.
    overflows : int
        Number of times that samples were not read in time.
    """

    rate: int
    overflows: int

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

    overflows = 0

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
        self._began, self._next = clock.now(), 0
        self._size = round(BLOCK_SECONDS * self.rate)

    def blocks(self) -> Iterator[Block]:
        """Yield the blocks that are over by now."""
        now = clock.now()
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

    A microphone that falls silent is logged once, and opened again in the background when it is back. If it then has
    another sample rate, its sound is resampled to the first one.

    Parameters
    ----------
    opener : callable
        Function that opens the sound, now and after a failure.

    Attributes
    ----------
    rate : int
        Samples per second of the sound beside takes.

    Raises
    ------
    SourceError
        The sound cannot be opened now.
    """

    def __init__(self, opener: Callable[[], SoundSource]) -> None:
        self._source: SoundSource | None = opener()  # None while it is opened again
        self.rate = self._source.rate
        self._opener = opener
        self._heard, self._lost = clock.now(), False
        self._closed, self._handing_over = threading.Event(), threading.Lock()
        self._reopened: queue.SimpleQueue[SoundSource] = queue.SimpleQueue()
        self._voice = Voice(self.rate)
        self._values: deque[tuple[float, float]] = deque(maxlen=round(KEPT_SECONDS / STEP_SECONDS))
        self._clocked = ClockedSound(self.rate)
        self._writer: WavWriter | None = None

    def voice_at(self, moment: float) -> float:
        """Return the channel at a moment of `puppetline.clock`; 0 if no sound has arrived shortly before it."""
        number = bisect_right(self._values, (moment, 1.0)) - 1
        if number < 0:
            return 0.0
        time_of_value, value = self._values[number]
        return value if moment - time_of_value < MISSING_SECONDS else 0.0

    @property
    def start(self) -> float | None:
        """Time of the first sample beside the take, in seconds of `puppetline.clock`; None before it."""
        return None if self._writer is None else self._clocked.start

    @property
    def overflows(self) -> int:
        """Number of times that samples of the present microphone were not read in time."""
        return 0 if self._source is None else self._source.overflows

    def take_in(self) -> None:
        """Process the sound that has arrived.

        Raises
        ------
        OutputError
            It cannot be written; it is heard nevertheless, and not written any more.
        """
        if not self._reopened.empty():
            self._source, self._heard = self._reopened.get(), clock.now()
        if self._source is None:
            return
        for given in self._source.blocks():
            self._heard = clock.now()
            if self._lost:
                self._lost = False
                log.info("the microphone is back")
            block = _resampled(given, self._source.rate, self.rate)
            values = self._voice.add(block.samples)
            end = block.time + len(block.samples) / self.rate
            self._values.extend((end - STEP_SECONDS * (len(values) - 1 - k), float(v)) for k, v in enumerate(values))
            if self._writer is not None:
                self._write(block)
        if clock.now() - self._heard > LOST_SECONDS:
            if not self._lost:
                self._lost = True
                log.warning("the microphone is silent; plug it in again, it is then used at once")
            silent, self._source = self._source, None
            threading.Thread(target=self._reopen, args=[silent], daemon=True).start()

    def record(self, path: Path) -> None:
        """Write the sound from now on.

        Raises
        ------
        OutputError
        """
        self._clocked, self._writer = ClockedSound(self.rate), WavWriter(path, self.rate)

    def stop(self) -> Path | None:
        """End the sound beside a take, and return its file; None without one."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()
        return None if writer is None else writer.path

    def close(self) -> None:
        """Release the microphone."""
        self.stop()
        with self._handing_over:
            self._closed.set()
        if not self._reopened.empty():
            self._source = self._reopened.get()
        if self._source is not None:
            self._source.close()

    def _reopen(self, silent: SoundSource) -> None:
        """Open the microphone again as soon as it is there, in a thread, because that takes a while."""
        silent.close()
        while not clock.block(clock.now() + RETRY_SECONDS, self._closed.wait):
            try:
                found = self._opener()
            except SourceError:
                continue
            with self._handing_over:
                if not self._closed.is_set():
                    self._reopened.put(found)
                    return
            found.close()

    def _write(self, block: Block) -> None:
        assert self._writer is not None  # noqa: S101 - checked by the caller
        try:
            self._writer.write(self._clocked.add(block))
        except BaseException:
            self._writer = None
            raise


def _resampled(block: Block, rate: int, wanted: int) -> Block:
    """Return a block with another sample rate."""
    if rate == wanted:
        return block
    places = np.arange(round(len(block.samples) * wanted / rate)) * (rate / wanted)
    return Block(block.time, np.interp(places, np.arange(len(block.samples)), block.samples).astype(np.float32))


def is_sound_file(name: str) -> bool:
    """Return whether a name is that of a file, not of a device."""
    return name.lower().endswith(".wav")


def open_sound(name: str, folder: Path) -> SoundInput:
    """Open ``"default"``, the system's microphone, or a device by name or number, or a .wav relative to a folder.

    Raises
    ------
    SourceError
    """
    if is_sound_file(name):
        return SoundInput(lambda: SoundFile(folder / name))
    return SoundInput(lambda: Microphone(None if name == "default" else name))
