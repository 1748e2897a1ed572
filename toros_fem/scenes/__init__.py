"""Ready scenes: for each kind its configuration, its case, and what is run."""
