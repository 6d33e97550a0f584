"""Contexts of OpenGL without a window, on a graphics card or in software."""

import sys
from typing import TYPE_CHECKING, Any

from puppetline.errors import OutputError

if TYPE_CHECKING:
    import moderngl

NO_WINDOW: tuple[dict[str, Any], ...] = ({"backend": "egl"}, {}) if sys.platform == "linux" else ({},)
"""How a context without a window is made, in the order in which the ways are tried."""

SOFTWARE = "llvmpipe", "softpipe"
"""Beginnings of the names of devices that are programs: Mesa's."""

INSTALL = (
    "Install it: pip install 'puppetline[film]'. "
    "On Debian without a display, also: apt install libegl1 libgl1 libgl1-mesa-dri"
)


def make_context() -> "moderngl.Context":
    """Return a context without a window."""
    try:
        import moderngl
    except ImportError:
        raise OutputError(
            "film", found="no ModernGL", expected="the extra film, which draws frames", fix=INSTALL
        ) from None
    reasons = []
    for options in NO_WINDOW:
        try:
            return moderngl.create_context(standalone=True, require=330, **options)
        except Exception as error:  # the library raises plain exceptions
            reasons.append(str(error))
    raise OutputError(
        "film",
        found=f"no graphics library with OpenGL 3.3 ({'; '.join(dict.fromkeys(reasons))})",
        expected="a graphics card's driver, or Mesa",
        fix="On Debian: apt install libegl1 libgl1 libgl1-mesa-dri",
    )
