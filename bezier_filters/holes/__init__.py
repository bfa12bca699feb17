"""Fills holes: finds them, continues surface and creases, and places the new faces."""
