"""Cameras: live ones and recordings as sources of pictures, their models and their health."""
