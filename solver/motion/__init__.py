"""Motion of a reduced model: from joints to bones and handles, and from these to control variables."""
