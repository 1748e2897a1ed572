"""Output of a run: console, summary, tables, fields and pictures; matplotlib is loaded on use."""
