"""Infrastructure: compiled kernels and their cache, threads, processes, atomic files."""
