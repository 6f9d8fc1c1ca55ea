"""`vsense doctor`: what this machine has and lacks, and the command that mends it."""
