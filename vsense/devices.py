"""Finds the virtual sensors and actuators: a module in their folder that names XML elements."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType
from typing import Any

from vsense.errors import VsenseError


def factories(package: ModuleType, error: type[VsenseError]) -> dict[str, Any]:
    """Gives what makes a device, by the name of its XML element.

    Args:
        package: the folder; a device's module holds `ELEMENTS`, the names of its XML elements,
            and `from_xml(element, scope)`.
        error: what to raise.

    Raises:
        error: two modules claim the same element.
    """
    found: dict[str, Any] = {}
    for module_info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{module_info.name}")
        for element_name in getattr(module, "ELEMENTS", ()):
            if element_name in found:
                raise error(f"{module.__name__}: <{element_name}> is another module's")
            found[element_name] = module.from_xml
    return found
