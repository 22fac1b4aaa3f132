"""An emulated ATI Wireless F/T sensor on the loopback interface, read by the driver; then half of its data are lost."""

import time

import numpy as np

from lwrprobe.contracts import DriverContext
from lwrprobe_ati import AtiConfig, AtiDriver
from lwrprobe_ati.emulator import AtiEmulator
from lwrprobe_rig.reactor import Reactor


def listen(sensor, seconds):
    """All samples of that time."""
    samples, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        samples += sensor.read()
        time.sleep(0.005)
    return samples


device = AtiEmulator("127.0.0.1:0", "127.0.0.1:0", active=[1])  # port 0: any free port
device.set_loads("1=1,-2,3.5,10,-20,30")  # transducer 1: N and N mm
with Reactor([device]):
    config = AtiConfig(telnet=device.telnet_address, udp=device.udp_address, local="127.0.0.1:0", transducer=1)
    sensor = AtiDriver(DriverContext(config, None)).sensor()
    sensor.open()
    samples = listen(sensor, 1.0)
    print(f"{len(samples)} samples in 1 s, nominal rate {sensor.rate:g} Hz")
    print("mean force", np.round(np.mean([sample.force for sample in samples], axis=0), 2), "N")
    device.set_faults("loss=0.5")
    before = len(samples)
    samples += listen(sensor, 1.0)
    lost = samples[-1].sequence - samples[before].sequence + 1 - (len(samples) - before)
    print(f"with half of the data lost: {len(samples) - before} samples came, {lost} are missing in the sequence")
    sensor.close()
