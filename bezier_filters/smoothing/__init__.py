"""Takes the noise off a mesh and leaves its edges."""
