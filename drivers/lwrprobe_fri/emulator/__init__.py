"""An emulated KRC2 lr that implements FRI 1.0 byte for byte; shares no code with the driver."""

from lwrprobe_fri.emulator.controller import Controller, ControllerSettings
from lwrprobe_fri.emulator.device import FriEmulator
from lwrprobe_fri.emulator.plant import LaggingArm, Plant
from lwrprobe_fri.emulator.rating import Thresholds

__all__ = ["Controller", "ControllerSettings", "FriEmulator", "LaggingArm", "Plant", "Thresholds"]
