"""Files, console lines and pictures of results."""
