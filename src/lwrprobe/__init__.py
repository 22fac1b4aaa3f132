"""lwrprobe: blind shape detection by touch.

``import lwrprobe as lp`` loads next to nothing: each name below is imported when it is first used.

=====================  =============================================================================================
`explore`              one exploration from start to end, a `Run`
`open_run`             a `Run` from its folder
`Run`, `Contacts`      what was found
`Summary`              all figures of a run, the content of `summary.json`
`Session`              one exploration step by step, in one's own loop
`load_scene`, `Scene`  scenes by name or file
`reconstruct`          a mesh from contacts, with any reconstructor
`evaluate`             a run or a mesh against the true shape, an `Evaluation`
`LwrprobeError`        root of all errors; `InputError` names field, value and what is allowed
=====================  =============================================================================================

The packages are reached the same way: `contracts`, `kinematics`, `trajectory`, `contact`, `mapping`, `collision`,
`scene`, `reconstruction`, `evaluation`, `exploration`. See docs/architecture.md.
"""

from typing import TYPE_CHECKING

from lwrprobe.lazy import imported_on_use

if TYPE_CHECKING:
    from lwrprobe import (
        collision,
        contact,
        contracts,
        evaluation,
        exploration,
        kinematics,
        mapping,
        reconstruction,
        scene,
        trajectory,
    )
    from lwrprobe.contracts import Done, Goal, Observation, Progress, Task, VelocityCommand
    from lwrprobe.errors import InputError, LwrprobeError
    from lwrprobe.evaluation.summary import Summary
    from lwrprobe.runs.evaluate import Evaluation, evaluate
    from lwrprobe.runs.explore import explore
    from lwrprobe.runs.reconstruct import reconstruct
    from lwrprobe.runs.run import Contacts, Run, open_run
    from lwrprobe.runs.session import Session
    from lwrprobe.scene import Scene, load_scene

__version__ = "0.1.0"

__all__ = [
    "Contacts",
    "Done",
    "Evaluation",
    "Goal",
    "InputError",
    "LwrprobeError",
    "Observation",
    "Progress",
    "Run",
    "Scene",
    "Session",
    "Summary",
    "Task",
    "VelocityCommand",
    "collision",
    "contact",
    "contracts",
    "evaluate",
    "evaluation",
    "exploration",
    "explore",
    "kinematics",
    "load_scene",
    "mapping",
    "open_run",
    "reconstruct",
    "reconstruction",
    "scene",
    "trajectory",
]

_MODULES = {
    "Contacts": "runs.run",
    "Done": "contracts",
    "Evaluation": "runs.evaluate",
    "Goal": "contracts",
    "InputError": "errors",
    "LwrprobeError": "errors",
    "Observation": "contracts",
    "Progress": "contracts",
    "Run": "runs.run",
    "Scene": "scene",
    "Session": "runs.session",
    "Summary": "evaluation.summary",
    "Task": "contracts",
    "VelocityCommand": "contracts",
    "evaluate": "runs.evaluate",
    "explore": "runs.explore",
    "load_scene": "scene",
    "open_run": "runs.run",
    "reconstruct": "runs.reconstruct",
}
"""Where each name that is no package comes from."""


__getattr__ = imported_on_use(__name__, _MODULES, set(__all__) - set(_MODULES))


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
