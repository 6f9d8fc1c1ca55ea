"""The command `vsense cameras`: what is plugged in, how it looks, and how it is set up."""
