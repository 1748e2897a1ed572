"""Fabrics with designed stiffness: periodic tiles, their profiles, design and pull tests."""
