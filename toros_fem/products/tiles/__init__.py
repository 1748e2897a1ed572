"""Tiles that repeat: designed towards a profile of stiffness, printed, and pulled (Fig. 7)."""
