"""The numbers of a glTF 2.0 file: buffers, the views on them, and the accessors that give them types.

Only data inside the file is read: the binary chunk of a GLB file, and base64 data within the JSON text. A buffer that
lies in another file is refused, and that file is not looked for.
"""

from __future__ import annotations

import binascii
import re

import numpy as np
from numpy.typing import NDArray

from dmp.formats.gltf_container import Container
from dmp.formats.json_items import Item
from dmp.formats.source import FormatError
from dmp.formats.text import show
from dmp.formats.zero_runs import refuse_zero_run
from dmp.mesh import FloatArray, IntArray

_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_INDEX_TYPES = (5121, 5123, 5125)
# Data that are all zeros need no bytes in the file.
_LARGEST_IMPLIED = 1 << 24
_TOLERANCE = 1e-4
_DATA = re.compile(r"data:[^,]{0,200};base64,", re.IGNORECASE)
_RESAVE = "Save or copy the file again from where it came from."
_UNCOMPRESSED = "Export it without compression, for example as plain GLB."
_AS_GLB = "Export the mesh as GLB, which keeps everything in one file."


class Accessors:
    """Reads the accessors of one file.

    Attributes:
        notes: full sentences on what is doubtful, added while reading.
    """

    def __init__(self, container: Container) -> None:
        self._document = container.document
        self._binary = container.binary
        self._start = container.binary_start
        self._buffers: dict[int, memoryview] = {}
        self._counts: dict[int, int] = {}
        self.notes: list[str] = []

    def count(self, index: int) -> int:
        """Return how many elements an accessor has, at least 1, all of which are in the file."""
        if index not in self._counts:
            self._counts[index] = len(self._stored(self._accessor(index)))
        return self._counts[index]

    def positions(self, index: int, *, quantised: bool) -> FloatArray:
        """Return positions, (n, 3), finite.

        Args:
            index: number of the accessor.
            quantised: whether whole numbers are allowed, as the extension KHR_mesh_quantization does.

        Raises:
            FormatError: when it is no accessor of positions, lies outside the file, or has a value that is not finite.
        """
        accessor = self._accessor(index)
        if accessor.text("type") != "VEC3":
            raise FormatError(f"{accessor.where}: positions must be of the type 'VEC3'", _RESAVE)
        values = self._read(accessor)
        if values.dtype.kind != "f" and not (quantised and values.dtype.itemsize < 4):
            raise FormatError(
                f"{accessor.where}: positions are of the component type {accessor.integer('componentType')}, "
                "which the file does not allow for them",
                _RESAVE,
            )
        good = np.isfinite(values).all(axis=1)
        if not good.all():
            row = int(good.argmin())
            raise FormatError(
                f"{self._place(accessor, row)}: position {row:,} of {accessor.where} has a coordinate that is not finite",
                "Remove the vertex and its faces, or save the mesh again.",
            )
        refuse_zero_run(values)
        self._refuse_zero_tail(accessor, values)
        self._check_limits(accessor, values)
        return _scaled(values, accessor.flag("normalized"))

    def indices(self, index: int) -> IntArray:
        """Return the indices of a primitive, (n,) int64."""
        accessor = self._accessor(index)
        if accessor.text("type") != "SCALAR" or accessor.integer("componentType") not in _INDEX_TYPES:
            raise FormatError(f"{accessor.where}: the indices of faces must be whole numbers without sign", _RESAVE)
        return self._read(accessor)[:, 0].astype(np.int64)

    def colours(self, index: int) -> NDArray | None:
        """Return colours, (n, 3) or (n, 4): numbers of 0 to 1, or whole numbers up to the largest of their type.

        None when they are of a type that glTF does not allow for colours.
        """
        accessor = self._accessor(index)
        values = self._read(accessor)
        whole = values.dtype.kind == "u" and accessor.flag("normalized") and values.dtype.itemsize < 4
        if values.shape[1] not in (3, 4) or not (whole or (values.dtype.kind == "f" and np.isfinite(values).all())):
            return None
        return values.astype(values.dtype.newbyteorder("="))

    def has_data(self, index: int) -> bool:
        """Tell whether an accessor has bytes of its own; those of compressed meshes may have none."""
        accessor = self._accessor(index)
        return accessor.has("bufferView") or accessor.has("sparse")

    def _accessor(self, index: int) -> Item:
        return self._document.entry("accessors", index, "accessor")

    def _read(self, accessor: Item) -> NDArray:
        """Return all elements, (count, components), in the type that the file has them in."""
        values = self._stored(accessor)
        if accessor.has("sparse"):
            values = self._with_replacements(accessor, values)
        return values

    def _stored(self, accessor: Item) -> NDArray:
        """Return all elements without the replacements, (count, components); nothing is copied."""
        dtype, width = self._type(accessor)
        count = accessor.integer("count")
        if count == 0:
            raise FormatError(f"{accessor.where}: 'count' is 0", _RESAVE)
        if accessor.has("bufferView"):
            return self._elements(accessor, count, dtype, width)
        if count * width * dtype.itemsize > _LARGEST_IMPLIED:
            raise FormatError(f"{accessor.where}: {count:,} elements are declared without any data", _RESAVE)
        return np.zeros((count, width), dtype=dtype)

    def _type(self, accessor: Item) -> tuple[np.dtype, int]:
        component, kind = accessor.integer("componentType"), accessor.text("type")
        if component not in _COMPONENTS or kind not in _SIZES:
            raise FormatError(
                f"{accessor.where}: the type '{show(kind.encode(errors='replace'))}' of {component} is unknown", _RESAVE
            )
        return np.dtype(_COMPONENTS[component]), _SIZES[kind]

    def _with_replacements(self, accessor: Item, values: NDArray) -> NDArray:
        """Return the elements with those replaced that the file gives one by one."""
        sparse = accessor.item("sparse")
        n = sparse.integer("count")
        if not 0 < n <= len(values):
            raise FormatError(f"{sparse.where}: {n:,} replaced elements are more than the {len(values):,} there are", _RESAVE)
        where, what = sparse.item("indices"), sparse.item("values")
        kind = where.integer("componentType")
        if kind not in _INDEX_TYPES:
            raise FormatError(f"{where.where}: the component type {kind} is no whole number without sign", _RESAVE)
        index_type = np.dtype(_COMPONENTS[kind])
        rows = self._elements(where, n, index_type, 1)[:, 0].astype(np.int64)
        if rows[-1] >= len(values) or (np.diff(rows) <= 0).any():
            raise FormatError(f"{where.where}: the replaced elements are not in order or out of range", _RESAVE)
        result = values.copy()
        result[rows] = self._elements(what, n, values.dtype, values.shape[1])
        return result

    def _elements(self, source: Item, count: int, dtype: np.dtype, width: int) -> NDArray:
        """Return ``count`` elements of ``width`` components; their bytes are checked before anything is read."""
        view = self._document.entry("bufferViews", source.integer("bufferView"), "buffer view")
        offset = source.integer("byteOffset", 0)
        if any(name.endswith("meshopt_compression") for name in view.item("extensions").values):
            raise FormatError(
                "the mesh is compressed with meshopt, which cannot be read",
                "Export it without compression, for example as GLB.",
            )
        data = self._buffer(view.integer("buffer"))
        start, length = view.integer("byteOffset", 0), view.integer("byteLength")
        if start + length > len(data):
            raise FormatError(
                f"{view.where} takes the bytes {start:,} to {start + length:,} of a buffer that has {len(data):,}",
                f"The file is damaged. {_RESAVE}",
            )
        element_bytes = width * dtype.itemsize
        stride = view.integer("byteStride", element_bytes)
        if stride < element_bytes:
            raise FormatError(f"{view.where}: elements of {element_bytes} bytes stand every {stride} bytes", _RESAVE)
        if offset + stride * (count - 1) + element_bytes > length:
            raise FormatError(
                f"{source.where}: {count:,} elements take {offset + stride * (count - 1) + element_bytes:,} bytes, "
                f"but {view.where} has {length:,}",
                f"The file is damaged. {_RESAVE}",
            )
        return np.ndarray((count, width), dtype, data, start + offset, (stride, dtype.itemsize))

    def _buffer(self, index: int) -> memoryview:
        if index not in self._buffers:
            self._buffers[index] = self._load(index)
        return self._buffers[index]

    def _load(self, index: int) -> memoryview:
        buffer = self._document.entry("buffers", index, "buffer")
        length = buffer.integer("byteLength")
        if not buffer.has("uri"):
            if index or self._binary is None:
                raise FormatError(f"{buffer.where} has no data in the file", f"{_AS_GLB} Without compression.")
            data = self._binary
        else:
            uri = buffer.text("uri")
            match = _DATA.match(uri)
            if match is None:
                name = "as data in a form that is not base64" if uri[:5].lower() == "data:" else "in another file"
                shown = "" if uri[:5].lower() == "data:" else f", '{show(uri.encode(errors='replace'))}', which is not opened"
                raise FormatError(f"{buffer.where} lies {name}{shown}", _AS_GLB)
            try:
                data = memoryview(_base64(uri[match.end() :]))
            except ValueError as error:  # binascii.Error is one
                raise FormatError(f"the base64 data of {buffer.where} is damaged", _RESAVE) from error
        if length > len(data):
            raise FormatError(
                f"{buffer.where} tells that it has {length:,} bytes, but there are {len(data):,}", f"It was cut off. {_RESAVE}"
            )
        return data[:length]

    def _place(self, accessor: Item, row: int) -> str:
        """Return the byte of the file at which an element stands, or the accessor where that cannot be told."""
        if not accessor.has("bufferView") or accessor.has("sparse"):
            return accessor.where
        view = self._document.entry("bufferViews", accessor.integer("bufferView"), "buffer view")
        if view.integer("buffer") or self._document.entry("buffers", 0, "buffer").has("uri"):
            return accessor.where
        dtype, width = self._type(accessor)
        stride = view.integer("byteStride", width * dtype.itemsize)
        start = self._start + view.integer("byteOffset", 0) + accessor.integer("byteOffset", 0)
        return f"byte {start + row * stride:,}"

    def _refuse_zero_tail(self, accessor: Item, values: NDArray) -> None:
        """Refuse positions that end in two of zeros, when nothing but zeros follows in their buffer either."""
        if len(values) < 3 or values[-2:].any() or not accessor.has("bufferView"):
            return
        view = self._document.entry("bufferViews", accessor.integer("bufferView"), "buffer view")
        data = self._buffer(view.integer("buffer"))
        if not any(data[view.integer("byteOffset", 0) + view.integer("byteLength") :]):
            raise FormatError(
                f"{accessor.where}: the positions end in zeros, so the file was never written to its end", _RESAVE
            )

    def _check_limits(self, accessor: Item, values: NDArray) -> None:
        """Note when positions do not lie within the limits that the file tells: a sign of damage, or of a careless program."""
        if not accessor.has("min") or not accessor.has("max"):
            return
        low, high = (np.array(accessor.numbers(key, 3)) for key in ("min", "max"))
        tolerance = _TOLERANCE * max(float(np.abs(high - low).max()), float(np.spacing(np.float32(np.abs([low, high]).max()))))
        actual = values.min(axis=0).astype(np.float64), values.max(axis=0).astype(np.float64)
        if (np.abs(actual[0] - low) > tolerance).any() or (np.abs(actual[1] - high) > tolerance).any():
            self.notes.append(
                f"The positions of {accessor.where} do not fit to the limits that the file tells for them; it may be damaged."
            )


def _base64(text: str) -> bytes:
    return binascii.a2b_base64(text + "=" * (-len(text) % 4), strict_mode=True)


def _scaled(values: NDArray, normalised: bool) -> FloatArray:
    """Return numbers as float64; normalised whole numbers become -1 to 1."""
    numbers = values.astype(np.float64)
    if normalised and values.dtype.kind != "f":
        numbers = np.maximum(numbers / np.iinfo(values.dtype).max, -1.0)
    return numbers
