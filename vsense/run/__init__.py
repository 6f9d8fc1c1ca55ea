"""What `vsense run` and `vsense lab` have in common: world, runtime, and who starts them."""
