"""From the sensor's reading to a contact on the sphere."""

from lwrprobe.contact.agreed_bias import AgreedBias, agreed_bias
from lwrprobe.contact.conditioner import BiasOutcome, Counters, WrenchConditioner
from lwrprobe.contact.deflection import Deflection
from lwrprobe.contact.drift import BiasChange, DriftWatch
from lwrprobe.contact.drift_rate import DriftRate
from lwrprobe.contact.estimator import (
    ESTIMATORS,
    REASONS,
    Estimator,
    Settings,
    check_estimator,
    make_estimator,
)
from lwrprobe.contact.limit_cycle import LimitCycle
from lwrprobe.contact.payload import Payload, identify_payload
from lwrprobe.contact.press_compliance import PressCompliance
from lwrprobe.contact.return_peaks import ReturnPeaks
from lwrprobe.contact.stick_contact import stick_contact
from lwrprobe.contact.torque_agreement import TorqueAgreement
from lwrprobe.contact.touch import TouchFit, zero_force_point
from lwrprobe.contact.touch_identification import TouchIdentification
from lwrprobe.contact.touch_rises import TouchRise, TouchRises
from lwrprobe.contact.wrench import UNCONFIRMED, Wrench, WrenchNoise
from lwrprobe.contracts.contact import RELIABLE_FROM

__all__ = [
    "ESTIMATORS",
    "REASONS",
    "RELIABLE_FROM",
    "UNCONFIRMED",
    "AgreedBias",
    "BiasChange",
    "BiasOutcome",
    "Counters",
    "Deflection",
    "DriftRate",
    "DriftWatch",
    "Estimator",
    "LimitCycle",
    "Payload",
    "PressCompliance",
    "ReturnPeaks",
    "Settings",
    "TorqueAgreement",
    "TouchFit",
    "TouchIdentification",
    "TouchRise",
    "TouchRises",
    "Wrench",
    "WrenchConditioner",
    "WrenchNoise",
    "agreed_bias",
    "check_estimator",
    "identify_payload",
    "make_estimator",
    "stick_contact",
    "zero_force_point",
]
