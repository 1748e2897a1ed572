"""Tubes, walkers and grippers of the paper, as demos share them."""
