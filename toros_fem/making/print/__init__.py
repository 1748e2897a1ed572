"""The print of a design: contours, widths, islands, printability."""
