"""The control room: what happens in a run, shown to people, and their orders; see README.md."""
