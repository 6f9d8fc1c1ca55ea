"""Pictures that a person looks at: the arena with the virtual world drawn in, and charts."""
