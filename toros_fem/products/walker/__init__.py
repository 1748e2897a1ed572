"""A robot that stands up or crawls (Figs. 9, 10)."""

from toros_fem.products.walker.gait import Gait

__all__ = [
    "Gait",
]
