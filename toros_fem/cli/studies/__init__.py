"""Studies: one scene with many values."""
