"""The reduced model of a surface: fields, energy matrices, rotation clusters, and the vertices bound to it."""
