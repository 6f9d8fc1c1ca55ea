"""XML files as elements that know their file and line."""
