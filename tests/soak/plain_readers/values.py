"""Texts, numbers, points and faces, as the plain readers of all formats take them."""

from __future__ import annotations

import math
import re

Point = tuple[float, float, float]
Polygons = tuple[list[Point], list[list[int]]]


def text_of(content: bytes) -> str:
    if content.startswith((b"\xff\xfe\0\0", b"\0\0\xfe\xff")):
        return content.decode("utf-32", errors="replace")
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    return content.removeprefix(b"\xef\xbb\xbf").decode("latin-1")


def lines_of(text: str) -> list[str]:
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def number_of(word: str) -> float:
    if not re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", word):
        raise ValueError(word)
    return float(word)


def point_of(values: list[float]) -> Point:
    if not all(map(math.isfinite, values)):
        raise ValueError(values)
    return values[0], values[1], values[2]


def welded(corners: list[Point], polygons: list[list[int]]) -> Polygons:
    """Join equal points in the order of their first appearance."""
    numbers: dict[Point, int] = {}
    new = [numbers.setdefault((x + 0.0, y + 0.0, z + 0.0), len(numbers)) for x, y, z in corners]
    return list(numbers), [[new[corner] for corner in polygon] for polygon in polygons]


def faces_of(cell: list[int], *, strip: bool) -> list[list[int]]:
    if not strip:
        return [cell]
    faces = [[cell[i + i % 2], cell[i + 1 - i % 2], cell[i + 2]] for i in range(len(cell) - 2)]
    return [face for face in faces if len(set(face)) == 3]
