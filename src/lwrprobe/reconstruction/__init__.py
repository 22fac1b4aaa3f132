"""Reconstruction: from contacts to a mesh, mesh files, and fits of simple shapes."""

from lwrprobe.reconstruction.reconstruct import reconstruct, record_from_cloud

__all__ = ["reconstruct", "record_from_cloud"]
