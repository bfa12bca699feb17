"""How values are shown: ranges and palettes of colours, tables for notebooks."""
