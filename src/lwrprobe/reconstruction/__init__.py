"""From touches to a mesh: reconstructors, their files and fits."""

from lwrprobe.reconstruction.reconstruct import reconstruct, record_from_cloud

__all__ = ["reconstruct", "record_from_cloud"]
