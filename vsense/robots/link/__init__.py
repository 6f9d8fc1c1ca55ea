"""The link to the robots: packets, sessions and the virtual sensor server."""
