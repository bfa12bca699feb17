"""Sharp edges, ridges and ravines."""
