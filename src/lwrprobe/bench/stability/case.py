"""What a stability case is, what it finds, and where the cases are."""

from __future__ import annotations

import math
import pkgutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

from lwrprobe.contracts import PluginError

COUNT = 40
"""Cases are numbered 1 to COUNT."""


@dataclass(slots=True, frozen=True)
class Finding:
    """One measurement of a case.

    Attributes
    ----------
    setting : what was set, in a few words
    happened : what the system did, a sentence
    value : the figure that decides, None where words decide
    bound : what `value` is held against
    unit : of both
    held : whether it passes; `within` sets it from value and bound
    """

    setting: str
    happened: str
    held: bool
    value: float | None = None
    bound: float | None = None
    unit: str = ""

    @property
    def sound(self) -> bool:
        """Passed, and the figure is a number."""
        return self.held and (self.value is None or math.isfinite(self.value))


def within(setting: str, happened: str, value: float, bound: float, unit: str, *, also: bool = True) -> Finding:
    """Passes when `value <= bound` and everything in words, `also`, is as wanted."""
    return Finding(setting, happened, bool(value <= bound and also), float(value), float(bound), unit)


@dataclass(slots=True, frozen=True)
class Case:
    """One stiff or extreme situation.

    Attributes
    ----------
    number : 1 to 40; title : a few words
    wanted : what a trustworthy system does
    run : takes `quick` (fewer settings) and returns its findings; an exception counts as falling short
    """

    number: int
    title: str
    wanted: str
    run: Callable[[bool], list[Finding]]


@dataclass(slots=True, frozen=True)
class Result:
    """A case after its run."""

    case: Case
    group: str
    findings: list[Finding]
    seconds: float

    @property
    def held(self) -> bool:
        """All findings pass."""
        return bool(self.findings) and all(finding.sound for finding in self.findings)


def all_cases() -> dict[int, tuple[str, Case]]:
    """Group and case by number: what every module of `lwrprobe.bench.stability.cases` has in its `CASES`.

    Raises PluginError for a number given twice or out of range.
    """
    from lwrprobe.bench.stability import cases

    found: dict[int, tuple[str, Case]] = {}
    for module in sorted(pkgutil.iter_modules(cases.__path__), key=lambda entry: entry.name):
        if module.name.startswith("_"):
            continue
        for case in import_module(f"{cases.__name__}.{module.name}").CASES:
            if case.number in found or not 1 <= case.number <= COUNT:
                raise PluginError(f"stability case {case.number} of {module.name}: given twice, or not 1 to {COUNT}")
            found[case.number] = (module.name, case)
    return dict(sorted(found.items()))


def run_case(group: str, case: Case, quick: bool) -> Result:
    """Run it; whatever it raises is a finding that falls short."""
    begin = time.perf_counter()
    try:
        findings = case.run(quick)
    except Exception as error:
        findings = [Finding("", f"raised {type(error).__name__}: {error}", False)]
    return Result(case, group, findings, time.perf_counter() - begin)
