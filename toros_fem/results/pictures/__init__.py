"""Pictures of designs, patterns, shapes and curves; matplotlib is loaded on use."""
