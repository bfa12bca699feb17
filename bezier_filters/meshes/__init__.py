"""Triangle meshes and point clouds: neighbours, frames, spatial order and diagnosis."""
