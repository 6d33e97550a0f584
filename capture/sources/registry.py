"""What a URI opens: ``demo:NAME``, ``replay:FILE``, ``osc:PORT``, ``camera:0``, ``openni:`` and more, see `SCHEMES`."""

from collections.abc import Callable
from pathlib import Path

from capture.network.source import open_osc, open_vmc
from capture.source import SkeletonSource
from capture.sources.demo import open_demo
from capture.sources.replay import RecordingSource
from puppetline.errors import SourceError

LOOP_SUFFIX = "?loop"

RECORDED_PREFIXES = ("demo:", "replay:", "video:", "openni:file=")
"""Sources that end."""


def open_source(uri: str, folder: Path = Path()) -> SkeletonSource:
    """Open a live source of skeletons.

    Parameters
    ----------
    uri : str
        A scheme, a colon, and what the scheme wants; see `SCHEMES`.
    folder : Path
        What the files of ``replay:`` and ``video:`` are relative to.

    Raises
    ------
    PuppetlineError
        An unknown scheme, or what the source itself has against it.
    """
    scheme, colon, rest = uri.partition(":")
    if not colon or scheme not in SCHEMES:
        raise SourceError(
            f"source {uri!r}",
            found=f"the scheme {scheme!r}" if colon else "no scheme",
            expected=f"one of {', '.join(SCHEMES)}",
            fix="Write it like osc:7110, replay:take.log?loop or demo:walk?loop.",
        )
    return SCHEMES[scheme](uri, rest, folder)


def _demo(uri: str, rest: str, _folder: Path) -> SkeletonSource:
    return open_demo(uri, rest.removesuffix(LOOP_SUFFIX), rest.endswith(LOOP_SUFFIX))


def _replay(uri: str, rest: str, folder: Path) -> SkeletonSource:
    return RecordingSource.of_file(uri, folder / rest.removesuffix(LOOP_SUFFIX), rest.endswith(LOOP_SUFFIX))


def _freenect(uri: str, rest: str, _folder: Path) -> SkeletonSource:
    from capture.sensors.freenect import open_freenect

    return open_freenect(uri, rest)


def _camera(uri: str, rest: str, _folder: Path) -> SkeletonSource:
    from capture.sensors.camera import open_camera

    return open_camera(uri, rest)


def _video(uri: str, rest: str, folder: Path) -> SkeletonSource:
    from capture.sensors.camera import open_video

    return open_video(uri, rest, folder)


def _openni(uri: str, rest: str, folder: Path) -> SkeletonSource:
    from capture.sensors.openni import open_openni

    return open_openni(uri, rest, folder)


def _fused(uri: str, rest: str, folder: Path) -> SkeletonSource:
    from capture.fusion.fused_file import open_fused

    return open_fused(uri, folder / rest, RECORDED_PREFIXES, open_source)


SCHEMES: dict[str, Callable[[str, str, Path], SkeletonSource]] = {
    "demo": _demo,
    "replay": _replay,
    "osc": lambda _uri, rest, _folder: open_osc(rest),
    "vmc": lambda _uri, rest, _folder: open_vmc(rest),
    "freenect": _freenect,
    "camera": _camera,
    "video": _video,
    "openni": _openni,
    "fused": _fused,
}
"""An example performance; a take or any skeleton log; senders in the network, all dialects; and VMC."""
