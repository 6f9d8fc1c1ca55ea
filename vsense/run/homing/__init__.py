"""Robots drive to their starts: who goes where, and on which ways, one arena state at a time."""
