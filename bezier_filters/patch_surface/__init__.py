"""The patches of all vertices as one surface: blended over faces, evaluated and queried anywhere."""
