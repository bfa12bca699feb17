"""Pictures of meshes and fields."""
