"""Scene files: TOML for the configurations of all kinds, read strictly."""
