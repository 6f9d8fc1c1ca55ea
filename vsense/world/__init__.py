"""What is not there plus what the cameras saw: the world that virtual sensors read."""
