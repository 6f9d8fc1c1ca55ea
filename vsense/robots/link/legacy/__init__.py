"""The link to robots that still run the original's client."""
