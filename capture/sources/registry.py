"""The registry of source URIs: ``demo:NAME``, ``replay:FILE``, ``osc:PORT``, ``camera:0``, ``openni:`` and others."""

import importlib
import re
from collections.abc import Callable
from pathlib import Path

from capture.network.source import open_osc, open_vmc
from capture.source import SENSOR_RECORDINGS, SkeletonSource
from capture.sources.demo import open_demo
from capture.sources.replay import RecordingSource
from puppetline.errors import SourceError
from puppetline.files import check_writable

LOOP_SUFFIX = "?loop"
"""End of the URI of a recording that plays in a loop."""

RECORDING_SENSORS = {"realsense": ".db3", "orbbec": ".bag"}
"""Ending of the recordings of each sensor that can record its images."""

Opener = Callable[[str, str, Path], SkeletonSource]
"""Opens a source, given the URI, its rest and the folder of files."""


def is_recorded(uri: str) -> bool:
    """Return whether a URI is that of a recording, which ends."""
    file = re.split("[&?]", uri)[0]
    return uri.startswith(("demo:", "replay:", "video:")) or file.endswith(SENSOR_RECORDINGS)


def open_source(uri: str, folder: Path = Path()) -> SkeletonSource:
    """Open a live source of skeletons.

    Parameters
    ----------
    uri : str
        A scheme of `SCHEMES`, a colon, and the rest that the scheme defines.
    folder : Path
        Folder to which the paths of files are relative.

    Raises
    ------
    PuppetlineError
        The scheme is unknown, or the source cannot be opened.
    """
    scheme, colon, rest = uri.partition(":")
    if not colon or scheme not in SCHEMES:
        raise SourceError(
            f"source {uri!r}",
            found=f"the scheme {scheme!r}" if colon else "no scheme",
            expected=f"one of {', '.join(SCHEMES)}",
            fix="Use a URI such as osc:7110, replay:take.log?loop or demo:walk?loop.",
        )
    return SCHEMES[scheme](uri, rest, folder)


def check_records(uri: str, path: Path) -> None:
    """Check that a source is a sensor that can record its images to a file.

    Raises
    ------
    SourceError
        The source is not a RealSense or an Orbbec sensor.
    OutputError
        The file cannot be written, or has another ending than the sensor's recordings.
    """
    scheme = uri.partition(":")[0]
    if scheme not in RECORDING_SENSORS or is_recorded(uri):
        raise SourceError(
            uri,
            found="a source whose sensor cannot record its images",
            expected="a sensor that is plugged in, realsense: or orbbec:",
            fix="Remove --sensor: takes of other sources have skeletons only.",
        )
    check_writable(path, RECORDING_SENSORS[scheme])


def open_recording_sensor(uri: str, path: Path) -> SkeletonSource:
    """Open a sensor that records its images to a file as long as it is open, see `check_records`."""
    scheme, _, rest = uri.partition(":")
    source: SkeletonSource = importlib.import_module(f"capture.sensors.{scheme}").open_source(uri, rest, Path(), path)
    return source


def _demo(uri: str, rest: str, _folder: Path) -> SkeletonSource:
    return open_demo(uri, rest.removesuffix(LOOP_SUFFIX), rest.endswith(LOOP_SUFFIX))


def _replay(uri: str, rest: str, folder: Path) -> SkeletonSource:
    return RecordingSource.of_file(uri, folder / rest.removesuffix(LOOP_SUFFIX), rest.endswith(LOOP_SUFFIX))


def _sensor(module: str) -> Opener:
    """Return the opener of a depth camera, whose module is imported when it is used."""

    def opened(uri: str, rest: str, folder: Path) -> SkeletonSource:
        source: SkeletonSource = importlib.import_module(f"capture.sensors.{module}").open_source(uri, rest, folder)
        return source

    return opened


def _camera(uri: str, rest: str, _folder: Path) -> SkeletonSource:
    from capture.sensors.camera import open_camera

    return open_camera(uri, rest)


def _video(uri: str, rest: str, folder: Path) -> SkeletonSource:
    from capture.sensors.camera import open_video

    return open_video(uri, rest, folder)


def _fused(uri: str, rest: str, folder: Path) -> SkeletonSource:
    from capture.fusion.fused_file import open_fused

    return open_fused(uri, folder / rest, is_recorded, open_source)


SCHEMES: dict[str, Opener] = {
    "demo": _demo,
    "replay": _replay,
    "osc": lambda _uri, rest, _folder: open_osc(rest),
    "vmc": lambda _uri, rest, _folder: open_vmc(rest),
    "freenect": _sensor("freenect"),
    "camera": _camera,
    "video": _video,
    "openni": _sensor("openni"),
    "orbbec": _sensor("orbbec"),
    "realsense": _sensor("realsense"),
    "fused": _fused,
}
"""Opener of each scheme."""
