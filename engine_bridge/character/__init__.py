"""Character files: reading glTF and other formats, shading, and a cache of results."""
