"""A skin from a mesh file."""
