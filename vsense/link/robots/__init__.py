"""The link to robots that run vsensed."""
