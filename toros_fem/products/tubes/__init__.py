"""Tubes that bend, shorten, twist, or only swell (Fig. 8)."""

from toros_fem.products.tubes.tube import SectionTubeScene, TubeScene

__all__ = ["SectionTubeScene", "TubeScene"]
