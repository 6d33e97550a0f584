"""The example motions as sources: ``demo:NAME``.

This is the only module of the product that uses the generated motions. `engine_bridge.character.examples` is the only
module that uses the generated characters.
"""

from collections.abc import Callable, Mapping

from capture.clip import SkeletonClip
from capture.sources.replay import RecordingSource
from puppetline.errors import SourceError


def performances() -> Mapping[str, Callable[[], SkeletonClip]]:
    """Return the functions that generate the example motions, by name."""
    # imported late, because SciPy's filters take half a second to load
    from puppetline.examples.performances import PERFORMANCES

    typed: Mapping[str, Callable[[], SkeletonClip]] = PERFORMANCES
    return typed


def open_demo(uri: str, name: str, loop: bool) -> RecordingSource:
    """Play the example motion of a name, once or in a loop.

    Raises
    ------
    SourceError
        No example motion has that name.
    """
    known = performances()
    if name not in known:
        raise SourceError(
            f"source {uri!r}",
            found=f"no example motion {name!r}",
            expected=f"one of {', '.join(known)}",
            fix="Use one of these names, for example demo:walk?loop.",
        )
    return RecordingSource.of_clips(uri, [known[name]()], loop)
