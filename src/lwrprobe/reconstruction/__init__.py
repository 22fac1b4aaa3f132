"""Reconstruction: from contacts to a mesh, mesh files, and fits of simple shapes."""

from lwrprobe.reconstruction.reconstruct import reconstruct

__all__ = ["reconstruct"]
