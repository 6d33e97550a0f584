"""Several sensors before the same performers: poses, clocks, and one skeleton out of many."""
