"""Experiment files: from `.argos` XML to checked, frozen records.

Every reader raises ConfigError, which names file, line, value and expectation, where something in
the file is wrong.
"""
