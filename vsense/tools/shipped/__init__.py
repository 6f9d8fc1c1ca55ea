"""What comes with vsense for people: pages and files to read, experiments to begin with."""
