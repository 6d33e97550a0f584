"""Export of motion: glTF animations, morph bases and shader meshes."""
