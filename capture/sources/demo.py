"""The example performances as sources: ``demo:NAME``.

This is the only place of the product that reaches performances made by code; `engine_bridge.cli.demo` is the only one
that reaches characters made by code.
"""

from collections.abc import Callable, Mapping

from capture.clip import SkeletonClip
from capture.sources.replay import RecordingSource
from puppetline.errors import SourceError


def performances() -> Mapping[str, Callable[[], SkeletonClip]]:
    """Return what makes each example performance, by its name."""
    # as it takes SciPy's filters, half a second
    from puppetline.examples.performances import PERFORMANCES

    made: Mapping[str, Callable[[], SkeletonClip]] = PERFORMANCES
    return made


def open_demo(uri: str, name: str, loop: bool) -> RecordingSource:
    """Play an example performance as a live source.

    Parameters
    ----------
    uri : str
        What the source is called.
    name : str
        A key of `performances`.
    loop : bool
        Whether it begins again at its end.

    Raises
    ------
    SourceError
        No performance has that name.
    """
    known = performances()
    if name not in known:
        raise SourceError(
            f"source {uri!r}",
            found=f"no performance {name!r}",
            expected=f"one of {', '.join(known)}",
            fix="Name one of these, as in demo:walk?loop.",
        )
    return RecordingSource.of_clips(uri, [known[name]()], loop)
