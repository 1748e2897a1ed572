"""Tubes that bend, shorten, twist, or only swell (Fig. 8)."""
