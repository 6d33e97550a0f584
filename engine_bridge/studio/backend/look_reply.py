"""Converts the service's report of what a source sees, and why nothing moves, to the form that pages read."""

from collections.abc import Callable
from typing import Any

from engine_bridge.studio.messages.performers import LookReply, SeenPerformer
from engine_bridge.studio.messages.state import Banner


def look_reply(seen: dict[str, Any], shown: Callable[[str], str]) -> LookReply:
    """Return the reply to a page.

    Parameters
    ----------
    seen : dict
        Reply of the service to `look` (docs/control.md).
    shown : callable
        Removes folders of this machine from a text.
    """
    picture = seen["picture"] or {"jpeg": "", "width": 0, "height": 0}
    return LookReply(
        picture=picture["jpeg"],
        width=picture["width"],
        height=picture["height"],
        problems=[
            Banner(level="warning", text=shown(each["what"]), fix=shown(each["fix"])) for each in seen["reasons"]
        ],
        performers=[
            SeenPerformer(user=each["user"], text=each["text"], joints=each["joints"]) for each in seen["performers"]
        ],
    )
