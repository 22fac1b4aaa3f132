"""The table of `cal`: the emulator's, recorded figures, and tables that must be refused."""

import numpy as np
import pytest

from lwrprobe.contracts import DeviceRefused
from lwrprobe_ati.calibration import parse_calibration
from lwrprobe_ati.emulator import Transducer

# Transducer 2, calibration 1, as recorded from a real device in 2017.
RECORDED = """
Tr Cal Gain Offset Row Axis G0 G1 G2 G3 G4 G5
-- --- ---- ------ --- ---- -- -- -- -- -- --
 2   1  598  31087   0   Fx   0.6105832   11.82515  -27.75596  -517.7919   28.04681   531.0735 Serial: FT00000
 2   1  622  32019   1   Fy    25.59246   616.7253  -14.80488  -284.2845  -18.88448  -315.8253 Date: 2012/09/18
 2   1  638  29522   2   Fz    593.0466   14.84871   558.9457  -10.66256   562.8641   10.35539 Part: SI-12-0.12
 2   1  650  31190   3   Tx    130.5689   3726.847   3047.324  -1787.495  -3209.956  -1953.829 Force:  1000000 counts/N
 2   1  614 28980  4  Ty   -3797.911  -156.7664    1916.83   3090.215   1702.124  -3183.832 Torque: 1000000 counts/N-mm
 2   1  602  30852   5   Tz    104.3058   2344.414   130.2406   2179.418   109.7938    2272.98 Mult:   ON
 2    0 MaxRatings:
 2    0 12 12 17 120 120 120
"""


def test_recorded_figures():
    calibration = parse_calibration(RECORDED, 2, 1)
    assert (calibration.transducer, calibration.number, calibration.serial) == (2, 1, "FT00000")
    assert calibration.force_counts == 1e6
    assert calibration.torque_counts == 1e9
    assert calibration.ratings.tolist() == pytest.approx([12, 12, 17, 0.12, 0.12, 0.12])
    assert calibration.device_multiplies
    assert calibration.matrix[4, 0] == -3797.911
    counts = np.array([1e6, -2e6, 3.5e6, 10e6, -20e6, 30e6])
    assert calibration.to_si @ counts == pytest.approx([1, -2, 3.5, 0.010, -0.020, 0.030])


def test_mult_off_lets_the_host_multiply():
    calibration = parse_calibration(RECORDED.replace("Mult:   ON", "Mult: OFF"), 2, 1)
    wrench = np.array([1.0, -2.0, 3.5, 0.010, -0.020, 0.030])
    gages = np.linalg.solve(calibration.matrix, wrench * np.repeat([1e6, 1e9], 3))
    assert np.abs(gages).max() < 32768
    assert calibration.to_si @ gages == pytest.approx(wrench)


@pytest.mark.parametrize("number", range(1, 7))
def test_emulated_tables_are_read(number):
    transducer = Transducer(number, 0.0, 3)
    calibration = parse_calibration("\n".join(transducer.table()), number, 1)
    assert calibration.matrix == pytest.approx(transducer.matrix)
    assert calibration.serial == f"FT{20000 + number}"


def test_voltage_calibration_is_refused():
    transducer = Transducer(2, 0.0, 3)
    transducer.calibration = 3
    with pytest.raises(DeviceRefused, match="calibration 3 of transducer 2 counts force per mV"):
        parse_calibration("\n".join(transducer.table()), 2, 3)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (("   Fz ", "   Fx "), "has the axes"),
        ((" 2   1  598", " 3   1  598"), "has the axes|printed the table of"),
        (("Force:  1000000", "Force:  0"), "no line 'Force"),
        (("Force:  1000000 counts/N\n", "\n"), "no line 'Force"),
        (("counts/N-mm", "counts/lbf-in"), "counts torque per lbf-in"),
        (("Mult:   ON", ""), "no line 'Mult"),
        (("12 12 17 120 120 120", "12 12 17 120 120"), "no line of six MaxRatings"),
        (("12 12 17 120 120 120", "12 12 17 0 120 120"), "no line of six MaxRatings"),
        ((" 2   1  602  30852   5   Tz", " 2   1  602"), "has the axes"),
        (("593.0466", "nan"), "has the axes"),
    ],
)
def test_tables_that_must_not_be_believed(change, reason):
    text = RECORDED.replace(*change)
    assert text != RECORDED
    with pytest.raises(DeviceRefused, match=reason):
        parse_calibration(text, 2, 1)


def test_singular_matrix_is_refused():
    ty = "-3797.911  -156.7664    1916.83   3090.215   1702.124  -3183.832"
    tx = "130.5689   3726.847   3047.324  -1787.495  -3209.956  -1953.829"
    with pytest.raises(DeviceRefused, match="singular"):
        parse_calibration(RECORDED.replace(ty, tx), 2, 1)


def test_table_of_another_transducer_is_refused():
    with pytest.raises(DeviceRefused, match="printed the table of transducer 2"):
        parse_calibration(RECORDED, 3, 1)
