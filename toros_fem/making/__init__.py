"""From a design to machine files: the print, panels to cut, beds and sheets."""
