"""Experiment files: from `.argos` XML to checked, frozen records."""
