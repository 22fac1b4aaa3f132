"""Names of a package that are imported when they are first used."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from typing import Any


def imported_on_use(package: str, origins: Mapping[str, str], modules: Collection[str] = ()) -> Callable[[str], Any]:
    """A package's `__getattr__`.

    Parameters
    ----------
    package : its full name
    origins : for each name the module in the package that it comes from
    modules : names that are themselves modules of the package
    """

    def get(name: str) -> Any:
        if name in modules:
            return import_module(f"{package}.{name}")
        if name not in origins:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{origins[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    return get
