"""Table `[safety]`: bounds that hold for every command of a strategy."""

from __future__ import annotations

from pydantic import Field

from lwrprobe.scene.table import Length, NonNegative, Table


class SafetyTable(Table):
    """What stops the arm. Joint ranges and speeds are the robot's own, the force limit is `contact.limit`."""

    joint_acceleration: Length = 60.0
    """rad/s^2 (m/s^2 of a prismatic joint) of any joint's set points."""
    joint_jerk: Length = 60_000.0
    """rad/s^3, over one cycle; a leap of the set point is far beyond it, an inverse kinematics at work is not."""
    tip_speed: Length = 0.25
    """m/s of the sphere's centre, the speed that ISO 10218-1 allows beside people."""
    torque_share: float = Field(default=0.8, gt=0, le=1)
    """Of the sensor's torque range; beyond it the tip yields as it does beyond the force limit."""
    margin: NonNegative = 0.05
    """m by which the sphere's centre may leave the area once the strategy has taken over."""
    table_penetration: NonNegative = 0.003
    """m by which the sphere may be commanded into the table."""
    following: Length = 0.15
    """rad (m) between a joint's set point and where it is: the arm has hit something, or no longer follows."""
    shift: NonNegative = 0.0006
    """m by which touches may contradict each other before the object counts as moved and the run ends; 0: unwatched."""
    silence: Length = 0.1
    """s of the arm's own time without a usable sensor sample, at least five of its periods; then stop and retreat."""
    arm_silence: Length = 1.0
    """s between two states of the arm; what the strategy planned before such a gap is not resumed."""
    sensor_wait: Length = 1.0
    """s of such silence after which the run ends; until then the tip waits off the surface and goes on by itself."""
    reentries: int = Field(default=30, ge=0)
    """How often in a run an arm that has stopped by itself is set in motion again; 0: never. One that was switched off,
    or has met a limit, waits for the operator (`--confirm`) and else ends the run."""
    reentry_time: Length = 10.0
    """s within which such an arm has to be ready again."""
    retreat: NonNegative = 0.02
    """m that the tip goes back on its own path when the sensor is lost, lifted off where it touched."""
    lift: NonNegative = 0.002
    """m off the surface on that path."""
