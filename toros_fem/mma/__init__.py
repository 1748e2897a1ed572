"""The method of moving asymptotes, distributed over ranks."""
