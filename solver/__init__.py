"""Geometry: a mesh becomes a reduced model, handle positions become a deformation. Arrays in, arrays out."""
