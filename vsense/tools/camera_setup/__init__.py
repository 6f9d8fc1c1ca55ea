"""The command `vsense camera list`: what is plugged in, how it looks, and how it is set up."""
