"""What the data say of a surface: its noise, its smoothness, and the fit that both ask for."""
