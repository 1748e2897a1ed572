"""Printable lines of a width along directions on the skin, joined across its seams."""
