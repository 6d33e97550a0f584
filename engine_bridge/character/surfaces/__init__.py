"""Mesh files that are not glTF: what they hold, as triangles that a glTF document can be made of."""
