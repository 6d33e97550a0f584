"""PyAV, which reads sounds and writes videos."""

from typing import Any

from puppetline.errors import OutputError


def require_av() -> Any:
    """Return the module of PyAV.

    Raises
    ------
    OutputError
        It is not installed.
    """
    try:
        import av
    except ImportError:
        raise OutputError(
            "film",
            found="no PyAV",
            expected="the extra film, which writes videos",
            fix="Install it: pip install 'puppetline[film]'.",
        ) from None
    return av
