"""The hot loops that fit every vertex."""
