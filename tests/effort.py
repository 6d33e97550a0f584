"""How much is done by tests that could go on for ever."""

import os

EFFORT = float(os.environ.get("PUPPETLINE_FUZZ", "0.3"))
"""Share of the work that a thorough run does; what is made up at random begins in the same way for any."""
