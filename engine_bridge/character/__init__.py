"""Character files in: glTF and other formats, their shading, and the cache of what is made of them."""
