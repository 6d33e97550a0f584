"""The geometry of a surface: its mesh, contacts between its parts, their winding, its Laplacian."""
