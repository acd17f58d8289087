"""What is measured of a mesh to be shown as colours; the window and the command line measure alike."""

from dmp.ruler import MeshState, Ruler, StateKey, StateKind, Surface, can_measure, direction_colors

__all__ = ["MeshState", "Ruler", "StateKey", "StateKind", "Surface", "can_measure", "direction_colors"]
