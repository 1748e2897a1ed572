"""From a design to machine files."""
