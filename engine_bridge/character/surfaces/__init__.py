"""Readers of mesh files other than glTF, which return surfaces of triangles."""
