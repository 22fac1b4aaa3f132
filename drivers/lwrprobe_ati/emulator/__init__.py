"""An emulated ATI Wireless F/T that implements the protocol byte for byte; shares no code with the driver."""

from lwrprobe_ati.emulator.device import AtiEmulator
from lwrprobe_ati.emulator.transducer import Transducer, Wrench

__all__ = ["AtiEmulator", "Transducer", "Wrench"]
