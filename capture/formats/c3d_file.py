"""C3D: the positions of markers, in binary form; read by the library c3d."""

import math
import re
import warnings
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from capture.clip import SkeletonClip
from capture.formats._files import opened
from capture.formats.clips import refuse_too_many
from capture.formats.options import ReadOptions
from capture.formats.positions import clip_of_positions, is_person
from capture.libraries import load_module
from puppetline.errors import SkeletonLogError

MAX_FRAMES = 1_000_000


def matches(head: bytes) -> bool:
    """Return whether a file's head has the number of the parameters' block and C3D's mark."""
    return len(head) > 512 and head[1] == 0x50 and 2 <= head[0] < 128 and b"\0" in head[:512]


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip, or one for each namespace that has a body's markers; markers with a negative residual are lost.

    Raises
    ------
    SkeletonLogError
        The library is missing, the file is damaged, or the markers are not those of a whole body.
    """
    library = load_module(
        "c3d",
        "the library c3d",
        found="no library for C3D files",
        expected="c3d",
        fix="Install it: pip install 'puppetline[c3d]'",
    )
    with opened(path) as file, warnings.catch_warnings(action="ignore"):
        try:
            reader = _markers_only(library.Reader)(file)
            names = [label.strip() for label in (reader.point_labels if reader.point_used else ())]
            rate = float(reader.point_rate)
            frames = [points[:, :4].copy() for _, points, _ in islice(reader.read_frames(), MAX_FRAMES + 1)]
        except Exception as error:  # the library raises errors of any kind for a damaged file
            raise SkeletonLogError(
                path,
                found=f"a C3D file that the library c3d cannot read ({type(error).__name__}: {error})",
                expected="markers in a C3D file",
                fix="Export the file again, or as TRC.",
            ) from error
    if not 0 < len(frames) <= MAX_FRAMES or not names or not rate > 0:
        raise SkeletonLogError(
            path,
            found=f"{len(frames)} frames of {len(names)} markers at {rate:g} per second",
            expected="motion of markers",
            fix="Export the file again.",
        )
    refuse_too_many(path, len(frames), len(frames[0]))
    table = np.array(frames, dtype=np.float64)[:, : len(names)]
    positions = np.where(table[..., 3:] < 0, np.nan, table[..., :3])
    times = np.arange(len(table)) / (options.fps or rate)
    names = names[: table.shape[1]]
    spaces = [re.split("[:|]", name)[0] for name in names]
    people = [[at for at, own in enumerate(spaces) if own == space] for space in dict.fromkeys(spaces)]
    people = [own for own in people if is_person([names[at] for at in own])]
    chosen = people if len(people) > 1 else [list(range(len(names)))]
    clips = [
        clip_of_positions(path, "c3d", [names[at] for at in own], positions[:, own], options, times=times)
        for own in chosen
    ]
    return [replace(clip, user=user) for user, clip in enumerate(clips)]


def _markers_only(reader: type[Any]) -> type[Any]:
    """Return a reader that leaves out forces, and takes the scale of the markers from the header.

    The library refuses files with scales that are stored as integers; the header's is always a float. It also refuses
    numbers of frames that are stored as a table of one row, and two different rates of forces.
    """

    class MarkerReader(reader):  # type: ignore[misc]
        @property
        def point_scale(self) -> float:
            return float(self.header.scale_factor)

        def get(self, group: str, default: Any = None) -> Any:
            parameter = super().get(group, default)
            if str(group).startswith("TRIAL:ACTUAL_") and parameter is not None:
                parameter.dimensions[:] = [math.prod(parameter.dimensions)]
            return parameter

        @property
        def analog_rate(self) -> float:
            return float(self.header.analog_per_frame * self.point_rate)

        def get_analog_transform(self) -> tuple[float, float]:
            return 1.0, 0.0

    return MarkerReader
