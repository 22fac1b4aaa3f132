"""The vocabulary of the library: all that a plug-in author has to know.

Plain dataclasses and protocols on numpy arrays, SI units, float64, world frame unless said otherwise.
"""

from lwrprobe.contracts.contact import Clearance, Confidence, Contact, Doubt
from lwrprobe.contracts.driver import (
    DRIVER_CONTRACT,
    Arm,
    BufferedArm,
    DelayedArm,
    Driver,
    DriverContext,
    GroundTruth,
    HealthCheck,
    LeftOut,
    MassiveArm,
    RestartableArm,
    Sensor,
    SteppedArm,
    TrueContact,
)
from lwrprobe.contracts.motion import Done, Goal, Motion, VelocityCommand, as_pose
from lwrprobe.contracts.probe import LinkShape, Probe
from lwrprobe.contracts.samples import ArmState, ArmStatus, SampleStatus, WrenchSample
from lwrprobe.contracts.strategy import (
    STRATEGY_CHANGES,
    STRATEGY_CONTRACT,
    Area,
    Bounds,
    CarefulStrategy,
    Observation,
    Progress,
    RaisingStrategy,
    SearchingStrategy,
    Strategy,
    Task,
)
from lwrprobe.contracts.surface import (
    RECONSTRUCTOR_CONTRACT,
    Reconstruction,
    Reconstructor,
    TouchRecord,
    TriangleMesh,
)
from lwrprobe.errors import (
    ConnectionLost,
    DeviceRefused,
    DriverError,
    FormatError,
    InputError,
    LwrprobeError,
    MissingExtraError,
    MotionInterrupted,
    PluginError,
    SafetyStop,
    SceneError,
    StorageError,
    UnknownNameError,
)

__all__ = [
    "DRIVER_CONTRACT",
    "RECONSTRUCTOR_CONTRACT",
    "STRATEGY_CHANGES",
    "STRATEGY_CONTRACT",
    "Area",
    "Arm",
    "ArmState",
    "ArmStatus",
    "Bounds",
    "BufferedArm",
    "CarefulStrategy",
    "Clearance",
    "Confidence",
    "ConnectionLost",
    "Contact",
    "DelayedArm",
    "DeviceRefused",
    "Done",
    "Doubt",
    "Driver",
    "DriverContext",
    "DriverError",
    "FormatError",
    "Goal",
    "GroundTruth",
    "HealthCheck",
    "InputError",
    "LeftOut",
    "LinkShape",
    "LwrprobeError",
    "MassiveArm",
    "MissingExtraError",
    "Motion",
    "MotionInterrupted",
    "Observation",
    "PluginError",
    "Probe",
    "Progress",
    "RaisingStrategy",
    "Reconstruction",
    "Reconstructor",
    "RestartableArm",
    "SafetyStop",
    "SampleStatus",
    "SceneError",
    "SearchingStrategy",
    "Sensor",
    "SteppedArm",
    "StorageError",
    "Strategy",
    "Task",
    "TouchRecord",
    "TriangleMesh",
    "TrueContact",
    "UnknownNameError",
    "VelocityCommand",
    "WrenchSample",
    "as_pose",
]


def __getattr__(name: str) -> object:
    """A name that an older strategy contract had: the sentence that says what to change, as an ImportError."""
    if name in ("Feed", "MapView"):
        raise ImportError(f"{name} was part of strategy contract 1; to change the strategy: {STRATEGY_CHANGES[1]}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
