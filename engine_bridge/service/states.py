"""The states of a character."""

from typing import Literal, get_args

State = Literal["waiting", "calibrating", "performing", "leaving"]
"""No performer; calibration of a performer; a performer drives the character; it eases away after one has left."""

STATES: tuple[State, ...] = get_args(State)
"""All states, in the order of their numbers in the wire protocol."""
