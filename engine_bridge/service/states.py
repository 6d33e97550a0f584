"""The states of a character."""

from typing import Literal, get_args

State = Literal["waiting", "calibrating", "performing", "leaving"]
"""No performer; the performer is being calibrated; the performer drives the character; it eases into its rest pose."""

STATES: tuple[State, ...] = get_args(State)
"""All states, in the order of their numbers in the wire protocol."""
