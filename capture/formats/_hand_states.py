"""Hand states of the Kinect v2 SDK as channels: 2 open, 3 closed, 4 lasso, which is pointing; others are unknown."""

_OPEN_AND_POINT = {2: (1.0, 0.0), 3: (0.0, 0.0), 4: (0.25, 1.0)}
"""``hand_open`` and ``point`` of each state; a hand that points has one of four fingers straight."""


def hand_channels(left: float, right: float) -> dict[str, float] | None:
    """Return the channels of the hands whose states are known; None if no state is."""
    channels = {}
    for side, state in (("left", left), ("right", right)):
        if state in _OPEN_AND_POINT:
            channels[f"hand_open_{side}"], channels[f"point_{side}"] = _OPEN_AND_POINT[int(state)]
    return channels or None
