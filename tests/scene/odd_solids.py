"""Solids whose edges are curves of every kind, for the tests."""

from lwrprobe.scene import Scene


def scene(*objects):
    return Scene.model_validate({"object": list(objects)})


def at(x=0.0, y=0.0, z=0.0, rpy=(0.0, 0.0, 0.0)):
    return {"xyz": [x, y, z], "rpy_deg": list(rpy)}


def box(x, y, z, **more):
    return {"shape": "box", "size": [x, y, z], **more}


def cylinder(radius, length, **more):
    return {"shape": "cylinder", "radius": radius, "length": length, **more}


def sphere(radius, **more):
    return {"shape": "sphere", "radius": radius, **more}


def capsule(radius, length, **more):
    return {"shape": "capsule", "radius": radius, "length": length, **more}


def difference(*children, **more):
    return {"shape": "difference", "children": list(children), **more}


def union(*children, **more):
    return {"shape": "union", "children": list(children), **more}


def intersection(*children, **more):
    return {"shape": "intersection", "children": list(children), **more}


ODD = {
    "ellipse": difference(box(0.05, 0.04, 0.03), cylinder(0.008, 0.1, at=at(rpy=(0, 35, 20)))),
    "cross_drilled": difference(cylinder(0.02, 0.05), cylinder(0.012, 0.06, at=at(rpy=(90, 0, 0)))),
    "tee": union(cylinder(0.015, 0.05), cylinder(0.010, 0.04, at=at(0.02, 0, 0, (0, 90, 0)))),
    "bitten_ball": difference(sphere(0.02), cylinder(0.01, 0.06, at=at(0.012, 0.003, 0.0))),
    "lens": intersection(sphere(0.02, at=at(-0.008)), sphere(0.018, at=at(0.01))),
    "ball_in_a_box": intersection(sphere(0.02), box(0.03, 0.035, 0.05, at=at(rpy=(0, 0, 15)))),
    "worn_capsule": difference(
        capsule(0.012, 0.03, at=at(rpy=(0, 20, 0))), box(0.02, 0.05, 0.02, at=at(0.012, 0, 0.004))
    ),
    "overlapping_slabs": union(box(0.03, 0.03, 0.01), box(0.03, 0.03, 0.01, at=at(0.01, 0.004, 0.006, (0, 0, 30)))),
    "two_pipes": union(cylinder(0.01, 0.05, at=at(-0.006)), cylinder(0.012, 0.05, at=at(0.007))),
}
