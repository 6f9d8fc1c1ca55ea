"""Packages of runs: `vsense pack` makes them, `vsense reproduce` makes everything in them again."""
