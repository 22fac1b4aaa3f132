"""Drivers as the runner finds and asks them: everything it uses is declared in the contract."""

from dataclasses import dataclass
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from lwrprobe.contracts import DRIVER_CONTRACT, Driver, InputError, PluginError, plugins
from lwrprobe.contracts.driver import DRIVER_CHANGES
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.simulated_time import SimulatedTime
from lwrprobe.scene import load_scene

START = np.arange(0.0, 0.7, 0.1)


class Still:
    """An arm and a sensor that only note what happens to them."""

    cycle, rate, latency = 0.01, 100.0, 0.0

    def __init__(self, log, name, fails=False):
        self.log, self.name, self.fails = log, name, fails

    def open(self):
        self.log.append(f"open {self.name}")
        if self.fails:
            raise OSError("no such device")

    def close(self):
        self.log.append(f"close {self.name}")


class Noted:
    """A driver of both roles by this contract."""

    @dataclass
    class Config:
        broken: bool = False

    contract = DRIVER_CONTRACT
    roles = frozenset({"arm", "sensor"})

    def __init__(self, context):
        self.context, self.log = context, []

    def arm(self):
        return Still(self.log, "arm")

    def sensor(self):
        return Still(self.log, "sensor", self.context.config.broken)

    def ground_truth(self):
        return None

    @property
    def left_out(self):
        return [{"stage": "gears", "why": "they are massless"}]

    def counters(self):
        return {"lost": 3}

    def health_checks(self, seconds):
        return []


class Silent(Noted):
    """One that counts nothing and leaves nothing out."""

    roles = frozenset({"sensor"})
    left_out = ()

    def counters(self):
        return {}


class Old(Noted):
    """One that was written for version 1."""

    contract = 1


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    """The drivers above, found by entry point beside the built-in ones."""
    own = {
        name: EntryPoint(name.lower(), f"{__name__}:{name}", "lwrprobe.drivers") for name in ("Noted", "Silent", "Old")
    }
    found = plugins._entries
    monkeypatch.setattr(plugins, "_entries", lambda kind: [*found(kind), *(own.values() if kind == "driver" else ())])


def devices(arm="noted", sensor="noted", **options):
    settings = {"arm.driver": arm, "sensor.driver": sensor, **{f"drivers.{arm}.{k}": v for k, v in options.items()}}
    return Devices.assemble(load_scene("empty", settings), 5, False, START)


def test_what_a_driver_counts_and_leaves_out_is_asked_of_every_driver():
    both = devices(sensor="silent")
    assert set(both.drivers) == {"noted", "silent"}
    assert both.counters() == {"noted": {"lost": 3}}
    assert both.left_out == [{"stage": "gears", "why": "they are massless"}]
    assert both.ground_truth is None
    assert all(isinstance(driver, Driver) for driver in both.drivers.values())


def test_a_driver_is_told_where_a_simulated_arm_starts():
    context = devices().drivers["noted"].context
    assert (context.seed, context.realtime, context.start_q.tolist()) == (5, False, START.tolist())


def test_a_driver_of_both_roles_is_made_once_and_goes_cycle_by_cycle():
    one = devices()
    assert list(one.drivers) == ["noted"]
    assert SimulatedTime.of(one, 7) is None


def test_the_simulator_goes_many_cycles_at_once():
    assert SimulatedTime.of(devices("sim", "sim"), 7) is not None


@pytest.mark.parametrize(("arm", "sensor"), [("sim", "ati"), ("sim", "silent"), ("fri", "sim"), ("mujoco", "sim")])
def test_a_simulated_device_is_not_combined_with_one_on_another_clock(arm, sensor):
    """The samples would never be at a time at which the arm was anywhere."""
    with pytest.raises(InputError, match=r"arm.driver, sensor.driver: got .* for both: it is simulated"):
        devices(arm, sensor)


def test_two_devices_on_the_clock_of_the_computer_are_combined():
    assert set(devices("fri", "ati").drivers) == {"fri", "ati"}


def test_both_devices_are_closed_where_one_does_not_open():
    broken = devices(broken=True)
    with pytest.raises(OSError, match="no such device"), broken:
        pass
    assert broken.drivers["noted"].log == ["open arm", "open sensor", "close arm", "close sensor"]


def test_a_driver_without_the_role_is_refused():
    with pytest.raises(InputError, match=r"arm\.driver"):
        devices("silent")


def test_a_driver_of_version_one_is_told_what_to_change():
    with pytest.raises(PluginError) as caught:
        devices("old")
    assert "written for contract 1, this lwrprobe speaks contract 2" in str(caught.value)
    assert DRIVER_CHANGES[1] in str(caught.value)
    for name in ("ground_truth()", "counters()", "health_checks()", "left_out", "step_many()", "cycles_until_sample()"):
        assert name in DRIVER_CHANGES[1]


def test_every_earlier_version_has_its_sentence():
    assert set(DRIVER_CHANGES) == set(range(1, DRIVER_CONTRACT))
