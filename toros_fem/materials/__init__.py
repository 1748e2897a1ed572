"""Laws of the sheets: membrane, bending, bladder, knit, and what a skin is made of."""
