"""The lab: photons and wheels are simulated here, and nothing else."""
