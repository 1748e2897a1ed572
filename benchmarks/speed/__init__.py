"""The same solves in two states of the code: counts, and the ratio of their times."""
