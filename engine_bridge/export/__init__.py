"""Motion out: glTF animations of several forms, morph bases and shader meshes."""
