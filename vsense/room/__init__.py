"""The control room: what happens in a run, told to whoever looks, and people's orders."""
