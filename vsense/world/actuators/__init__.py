"""Virtual actuators, one file per kind; a new file here is found by itself."""
