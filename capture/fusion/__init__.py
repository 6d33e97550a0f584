"""Fusion of several sensors that see the same performers: poses, clocks and fused skeletons."""
