"""TOML files, read strictly: line of each key, values with units, errors that name the place."""
