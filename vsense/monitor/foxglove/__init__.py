"""Foxglove's own messages, made of ours: for its 3-D, image and log panels.

Everything here computes: recordings, exports and the live server (`monitor/ui/_foxglove_server.py`)
    are told the same. The extra `foxglove` is needed by that server only.
"""

FOXGLOVE_PORT = 8765
"""Where Foxglove looks by itself."""
