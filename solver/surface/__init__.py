"""Geometry of a surface: mesh, contacts between parts, winding, Laplacian."""
