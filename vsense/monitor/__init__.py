"""Whatever looks at a run: the page, recordings, Foxglove, pictures."""
