"""Panels to cut: allowance, seams, marks, labels, the printed face, the bladder."""
