"""A robot that stands up or crawls (Figs. 9, 10)."""
