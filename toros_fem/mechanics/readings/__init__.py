"""What a solved skin tells on demand: error of a figure, wrinkles, holding force."""
