"""Triangle meshes and point clouds: neighbours, frames, order in space, and what is wrong with them."""
