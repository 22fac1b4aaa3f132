"""Finding plug-ins by entry point, without letting a broken one take anything else down.

Groups: `lwrprobe.drivers`, `lwrprobe.emulators`, `lwrprobe.strategies`, `lwrprobe.robots`,
`lwrprobe.reconstructors`. The built-in ones are declared in the same way as a third party's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from lwrprobe.contracts.driver import DRIVER_CHANGES, DRIVER_CONTRACT
from lwrprobe.contracts.strategy import STRATEGY_CHANGES, STRATEGY_CONTRACT
from lwrprobe.contracts.surface import RECONSTRUCTOR_CONTRACT
from lwrprobe.errors import PluginError, UnknownNameError

GROUPS = {
    "driver": "lwrprobe.drivers",
    "emulator": "lwrprobe.emulators",
    "strategy": "lwrprobe.strategies",
    "robot": "lwrprobe.robots",
    "reconstructor": "lwrprobe.reconstructors",
}

_OWN = "lwrprobe"
"""Distribution of the built-in plug-ins, whose names no other one takes over."""
_CONTRACTS = {"driver": DRIVER_CONTRACT, "strategy": STRATEGY_CONTRACT, "reconstructor": RECONSTRUCTOR_CONTRACT}
"""By kind; robots and emulators state none."""
_CHANGES: dict[str, dict[int, str]] = {"driver": DRIVER_CHANGES, "strategy": STRATEGY_CHANGES}


@dataclass(slots=True, frozen=True)
class Plugin:
    """One discovered plug-in.

    `broken` is the reason why it cannot be used, empty when it can; `loaded` is None until `load` is called.
    """

    kind: str
    name: str
    module: str
    distribution: str
    version: str
    loaded: Any = None
    broken: str = ""


def names(kind: str) -> list[str]:
    """Names of all plug-ins of a kind, sorted; imports none of them."""
    return sorted({entry.name for entry in _entries(kind)})


def discover(kind: str) -> list[Plugin]:
    """All plug-ins of a kind, imported; one that cannot be used is listed with its reason."""
    found = []
    for entry in sorted(_entries(kind), key=lambda e: e.name):
        plugin = _describe(kind, entry)
        others = [other.value for other in _named(kind, entry.name) if other.value != entry.value]
        if others and not _built_in(entry):
            plugin = replace(plugin, broken=f"{others[0]} has the same name")
        found.append(plugin)
    return found


def load(kind: str, name: str) -> Any:
    """The object behind one name.

    Raises UnknownNameError for an unknown name and PluginError, naming the plug-in, for one that cannot be
    imported or was written for another version of the contract.
    """
    found = _named(kind, name)
    if not found:
        raise UnknownNameError(kind, name, names(kind))
    if len(found) > 1 and not _built_in(found[0]):
        both = " and ".join(f"{entry.value} of {entry.dist.name if entry.dist else '?'}" for entry in found)
        raise PluginError(f"{kind} plug-in {name!r}: {both} have this name; uninstall one of them")
    plugin = _describe(kind, found[0])
    if plugin.broken:
        raise PluginError(f"{kind} plug-in {name!r} ({plugin.module}): {plugin.broken}")
    return plugin.loaded


def failed(kind: str, name: str, error: Exception) -> PluginError:
    """A plug-in's error in words that name the plug-in."""
    return PluginError(f"{kind} plug-in {name!r} failed: {type(error).__name__}: {error}")


def _entries(kind: str) -> list[EntryPoint]:
    if kind not in GROUPS:
        raise UnknownNameError("plug-in kind", kind, GROUPS)
    seen: dict[tuple[str, str], EntryPoint] = {}
    for entry in entry_points(group=GROUPS[kind]):
        seen.setdefault((entry.name, entry.value), entry)
    return sorted(seen.values(), key=lambda entry: not _built_in(entry))


def _named(kind: str, name: str) -> list[EntryPoint]:
    return [entry for entry in _entries(kind) if entry.name == name]


def _built_in(entry: EntryPoint) -> bool:
    return entry.dist is not None and entry.dist.name == _OWN


def _describe(kind: str, entry: EntryPoint) -> Plugin:
    dist, contract = entry.dist, _CONTRACTS.get(kind)
    loaded, broken = None, ""
    try:
        loaded = entry.load()
    except (Exception, SystemExit) as error:
        broken = f"{type(error).__name__}: {error}"
    else:
        stated = getattr(loaded, "contract", None)
        if contract is not None and stated != contract:
            broken = f"written for contract {stated}, this lwrprobe speaks contract {contract}"
            change = _CHANGES.get(kind, {}).get(stated) if isinstance(stated, int) else None
            broken += f"; to change it: {change}" if change else ""
    return Plugin(
        kind, entry.name, entry.value, dist.name if dist else "?", dist.version if dist else "?", loaded, broken
    )
