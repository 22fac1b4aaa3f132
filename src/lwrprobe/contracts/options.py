"""Options of a plug-in: a table of values into its `Config` dataclass, with errors a user can act on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar, get_type_hints

from lwrprobe.contracts import InputError, UnknownNameError

Config = TypeVar("Config")


def configure(config: type[Config], table: Mapping[str, Any], where: str) -> Config:
    """An instance of the dataclass `config` from `table`; missing keys keep their defaults.

    Raises UnknownNameError for a key that the dataclass lacks and InputError, named `where.key`, for a value of
    the wrong type; what the dataclass itself refuses in `__post_init__` passes through.
    """
    from pydantic import TypeAdapter, ValidationError

    known = {f.name for f in fields(config) if f.init}  # type: ignore[arg-type]
    hints = get_type_hints(config)
    values = {}
    for key, value in table.items():
        if key not in known:
            raise UnknownNameError(f"option of {where}", key, known)
        try:
            values[key] = TypeAdapter(hints[key]).validate_python(value)
        except ValidationError as error:
            raise InputError(f"{where}.{key}", value, error.errors()[0]["msg"].lower()) from None
    return config(**values)
