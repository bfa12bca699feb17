"""How things are run: compiled code, processes, files written whole."""
