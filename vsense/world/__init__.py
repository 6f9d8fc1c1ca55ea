"""The world that virtual sensors read; loop functions import from here: `Box`, `Light`, ..."""

from __future__ import annotations

from vsense.world.entities import Box, Cylinder, Light, VirtualRobot, Zone
from vsense.world.fields import Floor
from vsense.world.world import World

__all__ = ["Box", "Cylinder", "Floor", "Light", "VirtualRobot", "World", "Zone"]
