"""Skeleton input from sensors, network senders and recordings. Independent of meshes and engines."""
