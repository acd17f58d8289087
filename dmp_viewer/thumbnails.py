"""Small pictures of meshes, computed without OpenGL so that any thread can make them."""

from __future__ import annotations

from dmp.thumbnails import thumbnail

__all__ = ["thumbnail"]
