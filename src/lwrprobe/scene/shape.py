"""Shapes of a scene file: primitives, smooth blends, meshes, and what union, difference, intersection make of them.

Every shape stands in its own frame, centred on the frame's origin unless said otherwise, and is put into the
frame of its parent by `at`. Lengths in metres, 5 m at most.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar, get_args

from pydantic import Field, model_validator

from lwrprobe.scene.table import Length, NonNegative, Place, Pose, Refusal, Size, Table

MATERIAL = ("name", "friction", "stiffness", "damping", "movable", "mass")
"""Fields that belong to a whole object, never to a child of one."""

Kind = Literal["hull", "bumps", "extrusion", "revolution", "boolean", "organic", "thin", "steps", "stack"]
KINDS: tuple[str, ...] = get_args(Kind)
"""Kinds of random objects."""


class ShapeTable(Table):
    """What all shapes share; the material counts on the outermost shape, the object, alone."""

    at: Pose = Pose()
    name: str = ""
    friction: NonNegative = 0.3
    """Coulomb coefficient between object and sphere; printed resin on wood or metal."""
    stiffness: Length = 100_000.0
    """N/m, normal contact stiffness against the sphere; wood under a 5 mm sphere at 1 N (Hertz): 2.2e5."""
    damping: NonNegative = 5.0
    """N s/m, normal contact damping."""
    movable: bool = False
    """The object may slide on the table when it is pushed."""
    mass: Length = 0.5
    """kg, of a movable object."""


class Box(ShapeTable):
    """A cuboid; `size` is its full edges along x, y, z."""

    shape: Literal["box"]
    size: tuple[Size, Size, Size] = Field(strict=False)


class Cylinder(ShapeTable):
    """A circular cylinder with flat ends; its axis is z."""

    shape: Literal["cylinder"]
    radius: Size
    length: Size


class Sphere(ShapeTable):
    """A ball."""

    shape: Literal["sphere"]
    radius: Size


class Capsule(ShapeTable):
    """A cylinder along z with round ends; `length` is that of the axis, without the caps."""

    shape: Literal["capsule"]
    radius: Size
    length: Size


class HalfSpace(ShapeTable):
    """All points with z <= 0 in its own frame; only of use inside an intersection or a difference."""

    shape: Literal["half_space"]


class Ball(Table):
    """One ball of a blend."""

    centre: Place
    radius: Size


class Blend(ShapeTable):
    """A smooth union of balls, less a smooth union of other balls (`hollows`).

    With d_i the signed distance to ball i and k the smoothing length, the body is the set where
    s(p) = -k log sum exp(-d_i/k) is negative; each hollow b turns s into k log(exp(s/k) + exp(-d_b/k)).
    """

    shape: Literal["blend"]
    balls: tuple[Ball, ...] = Field(strict=False, min_length=1)
    hollows: tuple[Ball, ...] = Field(default=(), strict=False)
    smoothing: Size = 0.004


class Mesh(ShapeTable):
    """A closed triangle mesh from a file; a relative path starts at the scene file's folder."""

    shape: Literal["mesh"]
    file: str = Field(min_length=1)
    scale: Length = 1.0


class RandomObject(ShapeTable):
    """An object by kind and seed, 60 to 120 mm long by the seed: a closed mesh that stands on z = 0 about the z axis.

    Kinds: `hull` (convex), `bumps` (rounded with bumps and hollows), `extrusion` and `revolution` (of random outlines),
    `boolean` (primitives joined and cut), `organic` (smooth lumps), `thin` (walls and rods), `steps` (stairs and
    slots), `stack` (blocks, discs and prisms on one another).
    """

    shape: Literal["random"]
    kind: Kind
    seed: int = Field(ge=0, lt=2**63)
    length: Size | None = None
    """m, of the longer level side of its upright box; None = by the seed."""


class Union(ShapeTable):
    """All that belongs to at least one child."""

    shape: Literal["union"]
    children: tuple[Shape, ...] = Field(strict=False, min_length=1)

    _bare = model_validator(mode="after")(lambda self: refuse_material(self))


class Intersection(ShapeTable):
    """What belongs to every child."""

    shape: Literal["intersection"]
    children: tuple[Shape, ...] = Field(strict=False, min_length=2)

    _bare = model_validator(mode="after")(lambda self: refuse_material(self))


class Difference(ShapeTable):
    """The first child without all the others."""

    shape: Literal["difference"]
    children: tuple[Shape, ...] = Field(strict=False, min_length=2)

    _bare = model_validator(mode="after")(lambda self: refuse_material(self))


Shape = Annotated[
    Box | Cylinder | Sphere | Capsule | HalfSpace | Blend | Mesh | RandomObject | Union | Intersection | Difference,
    Field(discriminator="shape"),
]

Composite = TypeVar("Composite", Union, Intersection, Difference)

SHAPES = (
    "blend",
    "box",
    "capsule",
    "cylinder",
    "difference",
    "half_space",
    "intersection",
    "mesh",
    "random",
    "sphere",
    "union",
)


def refuse_material(composite: Composite) -> Composite:
    """A material on a child would silently count for nothing."""
    for n, child in enumerate(composite.children):
        for key in sorted(child.model_fields_set.intersection(MATERIAL)):
            allowed = f"{key} on the outermost shape only, not on a child"
            raise Refusal(f"children[{n}].{key}", getattr(child, key), allowed)
        if isinstance(child, Mesh | RandomObject) and composite.shape != "union":
            raise Refusal(
                f"children[{n}].shape", child.shape, f"no mesh inside of a {composite.shape}, only of a union"
            )
    return composite


for _composite in (Union, Intersection, Difference):
    _composite.model_rebuild()
