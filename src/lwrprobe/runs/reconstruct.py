"""A mesh from what was touched, with any reconstructor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lwrprobe.contracts import InputError, TouchRecord
from lwrprobe.runs.run import Contacts, Run

if TYPE_CHECKING:
    import trimesh


def reconstruct(
    contacts: Run | Contacts | TouchRecord | np.ndarray, method: str = "contact_surface", **options: Any
) -> trimesh.Trimesh:
    """A closed surface from contacts.

    Parameters
    ----------
    contacts : a run; contacts; a record for reconstructors; or points (n, 3) m alone, which not every method can use
    method : name of a reconstructor plug-in (`lwrprobe list reconstructors`)
    options : of the method

    Returns
    -------
    trimesh.Trimesh
        m, world frame; `metadata` holds the method's report, and where the method knows the expected error of each
        vertex [m] that is `vertex_attributes["vertex_error"]`.

    Raises
    ------
    UnknownNameError
        For an unknown method or option.
    InputError
        For contacts that carry no surface.
    """
    from lwrprobe.reconstruction.meshes import as_trimesh
    from lwrprobe.reconstruction.reconstruct import reconstruct as run

    found = run(_record(contacts), method, **options)
    mesh = as_trimesh(found.mesh)
    mesh.metadata |= found.report
    return mesh


def _record(contacts: object) -> TouchRecord:
    if isinstance(contacts, Run):
        return contacts.record
    if isinstance(contacts, TouchRecord):
        return contacts
    if isinstance(contacts, Contacts):
        return TouchRecord(contacts.points, contacts.normals, contacts.confidence, contacts.times)
    try:
        return TouchRecord(np.asarray(contacts, dtype=np.float64))
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("contacts", contacts, "a Run, Contacts, a TouchRecord or points (n, 3)") from None
