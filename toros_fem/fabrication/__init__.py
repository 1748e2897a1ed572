"""The printed region: contours, widths, islands, printability, and its simulation."""
