"""Runs of several conditions compared as a paper wants it: tests, effect sizes, figures, words."""
