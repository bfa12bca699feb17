"""How things are run: compiled code, threads, processes, files written whole."""
