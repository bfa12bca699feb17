"""The public estimate of normals, curvatures and torsion, with sharp edges under noise."""
