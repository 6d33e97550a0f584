"""Motion of a reduced model: joints to bones and handles, bones and handles to control variables."""
