"""Checks of requests beyond the types of their values, and their errors."""

from engine_bridge.studio.messages import base
from puppetline.errors import ServiceError, unknown_name


def check_one(asked: base.Request, keys: tuple[str, ...]) -> None:
    """Refuse a request that does not have exactly one of the keys."""
    given = [key for key in keys if getattr(asked, key) is not None]
    if len(given) != 1:
        raise ServiceError(
            "the request",
            found=" and ".join(given) or "no source",
            expected=f"one of {', '.join(keys)}",
            fix="Give exactly one of them.",
        )


def in_use(name: str) -> ServiceError:
    """Return the error for a recording that cannot be deleted now."""
    return ServiceError(
        name,
        found="a recording that is playing now",
        expected="a recording that is not in use",
        fix="Choose another source, or stop the take that plays.",
    )


def check_known(name: str, known: list[str], key: str) -> None:
    """Refuse a name that is not in `known`; `key` is the name's key in the request."""
    if name not in known:
        raise unknown_name(f"the request, {key}", f"the unknown name {name!r}", known)
