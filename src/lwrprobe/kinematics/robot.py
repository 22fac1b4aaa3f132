"""A serial robot arm described by Denavit-Hartenberg parameters."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from lwrprobe.contracts import InputError, LinkShape, as_pose
from lwrprobe.kinematics import batched_kernels
from lwrprobe.kinematics import chain_kernels as kernels

if TYPE_CHECKING:
    from spatialmath import SE3

Array = np.ndarray
Convention = Literal["standard", "modified"]


@dataclass(frozen=True, eq=False)
class Robot:
    """A chain of n revolute and prismatic joints between a base and a tool.

    Joint values are rad, and m for prismatic joints; everything else is SI too.

    Attributes
    ----------
    name : of the model
    a, alpha, d, theta : (n,) link length [m], twist [rad], offset [m], angle [rad]; the joint's value is added to
        `theta`, or to `d` where `prismatic`
    lower, upper : (n,) joint limits, `-inf` and `inf` where there is none
    speed : (n,) greatest joint speed per second
    prismatic : (n,) bool, none by default
    convention : `standard` (Denavit and Hartenberg 1955) or `modified` (Craig 1986)
    base : (4, 4) first link's frame in the world
    tool : (4, 4) tip in the last link's frame
    links : the arm's own bodies from the base outwards, each carried by one of its link frames (`link_frames`); none
        where they are not known
    """

    name: str
    a: Array
    alpha: Array
    d: Array
    theta: Array
    lower: Array
    upper: Array
    speed: Array
    prismatic: Array = field(default_factory=lambda: np.zeros(0, bool))
    convention: Convention = "standard"
    base: Array = field(default_factory=lambda: np.eye(4))
    tool: Array = field(default_factory=lambda: np.eye(4))
    links: tuple[LinkShape, ...] = ()
    chain: Array = field(init=False, repr=False)
    """The table the kernels read (see chain_kernels); not to be written to."""

    def __post_init__(self) -> None:
        n = np.size(self.a)
        if n == 0:
            raise InputError("robot.a", self.a, "at least one joint")
        for name in ("a", "alpha", "d", "theta", "lower", "upper", "speed"):
            object.__setattr__(self, name, _column(f"robot.{name}", getattr(self, name), n))
        prismatic = np.asarray(self.prismatic, bool) if np.size(self.prismatic) else np.zeros(n, bool)
        if prismatic.shape != (n,):
            raise InputError("robot.prismatic", prismatic.shape, f"the shape ({n},)")
        object.__setattr__(self, "prismatic", prismatic)
        object.__setattr__(self, "base", as_pose(self.base, "robot.base").copy())
        object.__setattr__(self, "tool", as_pose(self.tool, "robot.tool").copy())
        self._check()
        object.__setattr__(self, "chain", self._table())

    def _check(self) -> None:
        for name in ("a", "alpha", "d", "theta"):
            if not np.isfinite(getattr(self, name)).all():
                raise InputError(f"robot.{name}", getattr(self, name).tolist(), "finite numbers only")
        if not (self.lower <= self.upper).all():
            raise InputError("robot.lower", self.lower.tolist(), f"not above robot.upper = {self.upper.tolist()}")
        if not (self.speed > 0.0).all():
            raise InputError("robot.speed", self.speed.tolist(), "positive numbers")
        for link in self.links:
            if not (link.carrier.isdecimal() and int(link.carrier) <= self.n):
                raise InputError(f"link {link.name}.carrier", link.carrier, f"a link frame, '0' to '{self.n}'")
        if self.convention not in ("standard", "modified"):
            raise InputError("robot.convention", self.convention, "'standard' or 'modified'")

    def _table(self) -> Array:
        chain = np.zeros((self.n + 2, max(16, self.n)))
        chain[0, :12] = self.base[:3].ravel()
        chain[-1, :12] = self.tool[:3].ravel()
        chain[0, kernels.LENGTH] = self.length
        chain[0, kernels.MODIFIED] = self.convention == "modified"
        joints = chain[1:-1]
        joints[:, kernels.A], joints[:, kernels.D], joints[:, kernels.THETA] = self.a, self.d, self.theta
        joints[:, kernels.COS_ALPHA], joints[:, kernels.SIN_ALPHA] = _cos_sin(self.alpha)
        joints[:, kernels.PRISMATIC] = self.prismatic
        joints[:, kernels.LOWER], joints[:, kernels.UPPER] = self.lower, self.upper
        joints[:, kernels.SPEED] = self.speed
        joints[:, kernels.UNIT] = np.where(self.prismatic, self.length, 1.0)
        return chain

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.a)

    @property
    def length(self) -> float:
        """m, of the outstretched chain with its tool: the scale by which the solvers weigh metres against radians."""
        ends = np.where(self.prismatic, np.maximum(np.abs(self.lower), np.abs(self.upper)), 0.0)
        reach = np.sum(np.abs(self.a) + np.abs(self.d) + np.where(np.isfinite(ends), ends, 0.0))
        reach += np.linalg.norm(self.tool[:3, 3])
        return float(reach) if reach > 0.0 else 1.0

    @property
    def middle(self) -> Array:
        """(n,) the middle of the joint ranges, 0 for a joint without limits."""
        endless = ~(np.isfinite(self.lower) & np.isfinite(self.upper))
        low, high = np.where(endless, 0.0, self.lower), np.where(endless, 0.0, self.upper)
        return np.where(endless, np.clip(0.0, self.lower, self.upper), 0.5 * (low + high))

    @property
    def span(self) -> tuple[Array, Array]:
        """Ends (n,) and (n,) of joint values to draw: the limits, and half a turn off `middle` where there is none."""
        low, high = self.middle - np.pi, self.middle + np.pi
        return np.where(np.isfinite(self.lower), self.lower, low), np.where(np.isfinite(self.upper), self.upper, high)

    @property
    def swinging_links(self) -> tuple[LinkShape, ...]:
        """The bodies beyond the first joint's: that one turns above its foot, next to what the arm stands on."""
        return tuple(link for link in self.links if int(link.carrier) > 1)

    def with_tool(self, tool: SE3 | Array) -> Robot:
        """The same arm with another tool (4, 4)."""
        return replace(self, tool=as_pose(tool, "tool"))

    def with_base(self, base: SE3 | Array) -> Robot:
        """The same arm standing elsewhere, base (4, 4)."""
        return replace(self, base=as_pose(base, "base"))

    def with_table_changed(self, change: Array) -> Robot:
        """The same arm, its table changed by (4, n): of `a` [m], `alpha` [rad], `d` [m] and `theta` [rad]."""
        a, alpha, d, theta = change
        return replace(self, a=self.a + a, alpha=self.alpha + alpha, d=self.d + d, theta=self.theta + theta)

    def with_limits(self, lower: Array, upper: Array) -> Robot:
        """The same arm with other joint limits (n,)."""
        return replace(self, lower=lower, upper=upper)

    def fk(self, q: Array) -> SE3:
        """The tip for joint values q (n,). Raises InputError for a wrong shape or a NaN."""
        from spatialmath import SE3

        out = np.empty((4, 4))
        kernels.forward(self.chain, self.joint_values(q), out)
        return SE3(out, check=False)

    def fk_into(self, q: Array, out: Array) -> None:
        """The tip for q (n,) into out (4, 4); float64, C order, unchecked: the fast path."""
        kernels.forward(self.chain, q, out)

    def fk_batch(self, qs: Array) -> Array:
        """The tips (m, 4, 4) for joint values qs (m, n)."""
        qs = self.joint_values(qs, "qs", 2)
        out = np.empty((len(qs), 4, 4))
        if len(qs) < batched_kernels.LANES:
            kernels.forward_batch(self.chain, qs, out)
        else:
            batched_kernels.forward_lanes(self.chain, qs, np.empty((batched_kernels.ROWS, batched_kernels.LANES)), out)
        return out

    def link_frames(self, q: Array) -> Array:
        """(n + 1, 4, 4): the base and every link's frame in the world, in the table's own convention."""
        out = np.empty((self.n + 1, 4, 4))
        kernels.link_frames(self.chain, self.joint_values(q), out)
        return out

    def link_frames_into(self, q: Array, out: Array) -> None:
        """`link_frames` into out (n + 1, 4, 4), unchecked."""
        kernels.link_frames(self.chain, q, out)

    def jacobian(self, q: Array) -> Array:
        """(6, n): the tip's linear [m/s] over angular [rad/s] velocity in the world frame per joint speed."""
        out = np.empty((6, self.n))
        kernels.jacobian(self.chain, self.joint_values(q), out)
        return out

    def jacobian_into(self, q: Array, out: Array) -> None:
        """`jacobian` into out (6, n); float64, C order, unchecked: the fast path."""
        kernels.jacobian(self.chain, q, out)

    def jacobian_batch(self, qs: Array) -> Array:
        """(m, 6, n) for joint values qs (m, n)."""
        qs = self.joint_values(qs, "qs", 2)
        out = np.empty((len(qs), 6, self.n))
        kernels.jacobian_batch(self.chain, qs, out)
        return out

    def manipulability(self, q: Array) -> float:
        """sqrt(det(J J')) (Yoshikawa 1985), 0 at a singularity; of J' J for an arm with fewer than six joints."""
        return float(self.manipulability_batch(self.joint_values(q)[None])[0])

    def manipulability_batch(self, qs: Array) -> Array:
        """(m,) for joint values qs (m, n)."""
        jacs = self.jacobian_batch(qs)
        turned = jacs.transpose(0, 2, 1)
        gram = jacs @ turned if self.n >= 6 else turned @ jacs
        return np.sqrt(np.maximum(np.linalg.det(gram), 0.0))

    def limit_margin(self, q: Array) -> float:
        """Distance to the nearest joint limit (rad, m for prismatic joints); negative beyond it."""
        q = self.joint_values(q)
        return float(np.minimum(q - self.lower, self.upper - q).min())

    def within_limits(self, q: Array, slack: float = 0.0) -> bool:
        """True where every joint value of q (n,) is within its limits."""
        return self.limit_margin(q) >= -slack

    def speed_use(self, q: Array, q_next: Array, seconds: float) -> float:
        """Share of the speed limit that the busiest joint needs to go from q to q_next (n,) in that time; 1 = all."""
        return float(np.max(np.abs(q_next - q) / self.speed) / seconds)

    def joint_values(self, q: Array, name: str = "q", ndim: int = 1) -> Array:
        """q as float64 in C order. Raises InputError naming it for a wrong shape, a NaN or an infinity."""
        try:
            q = np.ascontiguousarray(q, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(name, q, f"{self.n} numbers") from error
        if q.ndim != ndim or q.shape[-1] != self.n:
            raise InputError(name, q.shape, f"{self.n} joint values" if ndim == 1 else f"an (m, {self.n}) array")
        if not np.isfinite(q).all():
            raise InputError(name, q.tolist(), "finite numbers only")
        return q


def _column(name: str, value: Array, n: int) -> Array:
    column = np.array(value, dtype=np.float64)
    if column.shape != (n,):
        raise InputError(name, column.shape, f"the shape ({n},), one number a joint")
    if np.isnan(column).any():
        raise InputError(name, column.tolist(), "no NaN")
    return column


def _cos_sin(alpha: Array) -> tuple[Array, Array]:
    """Exact for multiples of a quarter turn, where pi/2 in floating point would leave 6e-17 behind."""
    quarters = alpha / (0.5 * np.pi)
    exact = np.abs(quarters - np.round(quarters)) < 1e-14
    cos, sin = np.cos(alpha), np.sin(alpha)
    return np.where(exact, np.round(cos), cos), np.where(exact, np.round(sin), sin)
