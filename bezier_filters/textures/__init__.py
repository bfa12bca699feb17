"""Images over the texture coordinates of a mesh: curvature, cavity, convexity and normal maps."""
