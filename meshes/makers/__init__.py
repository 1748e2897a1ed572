"""Ready-made patterns: sheets, tubes, flat robots, tiles, moulded skins."""
