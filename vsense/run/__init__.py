"""What `vsense run` and `vsense lab` have in common, and `vsense run` itself."""
