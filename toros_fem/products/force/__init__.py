"""Forces of a finished design: its blocked end, its stiffness, what a pump gives."""
