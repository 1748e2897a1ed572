"""The command `toros`, and scene files."""
