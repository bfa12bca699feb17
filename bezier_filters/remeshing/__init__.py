"""New meshes on the surface of the patches: finer ones, and regular ones."""
