"""Small injuries to good files, each drawn from a generator of random numbers so that a seed and a number repeat it."""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
from collections.abc import Callable

import numpy as np

from tests.dmp.formats.containers import pack_glb, pack_zip

NASTY = [
    *(b"nan", b"inf", b"-1", b"0", b"1e999", b"-1e-400", b"4294967295", b"-2147483648", b"9223372036854775807"),
    *(b"99999999999999999999", b"1,5", b"0x1F", b"1_000", b"", b" ", b"\n", b"\r", b"\\\n", b"\0", b"\xff\xfe"),
    *(b"\xef\xbb\xbf", b"#", b"/", b"//", b"-", b".", b"v", b"f", b"end_header\n", b"element vertex 3\n"),
    *(b"property list int int x\n", b"OFF\n", b"solid ", b"endsolid\n", b"ply\n", b"{", b"}", b"[]", b'"', b"null", b"true"),
    *(b"<", b"/>", b"&#0;", b"<!-- ", b"<![CDATA[", b"</mesh>", b"</Piece>", b"POLYGONS 1 4\n", b"METADATA\n", b"PK\3\4"),
]

Injury = Callable[[bytearray, np.random.Generator], bytearray]


def flip_bits(content: bytearray, rng: np.random.Generator) -> bytearray:
    for _ in range(rng.integers(1, 5)):
        content[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
    return content


def flip_bits_of_the_head(content: bytearray, rng: np.random.Generator) -> bytearray:
    content[rng.integers(min(300, len(content)))] ^= 1 << int(rng.integers(8))
    return content


def cut(content: bytearray, rng: np.random.Generator) -> bytearray:
    return content[: rng.integers(len(content))]


def delete(content: bytearray, rng: np.random.Generator) -> bytearray:
    start = int(rng.integers(len(content)))
    del content[start : start + int(rng.integers(1, 60))]
    return content


def repeat(content: bytearray, rng: np.random.Generator) -> bytearray:
    start, target = rng.integers(len(content), size=2)
    content[target:target] = content[start : start + int(rng.integers(1, 200))]
    return content


def zero(content: bytearray, rng: np.random.Generator) -> bytearray:
    start = int(rng.integers(len(content)))
    length = min(int(rng.integers(1, 500)), len(content) - start)
    content[start : start + length] = bytes(length)
    return content


def zero_the_tail(content: bytearray, rng: np.random.Generator) -> bytearray:
    length = int(rng.integers(64, max(len(content), 65) + 1))
    return content[: max(len(content) - length, 0)] + bytes(min(length, len(content)))


def noise(content: bytearray, rng: np.random.Generator) -> bytearray:
    start = int(rng.integers(len(content)))
    length = min(int(rng.integers(1, 30)), len(content) - start)
    content[start : start + length] = rng.bytes(length)
    return content


def insert_something_nasty(content: bytearray, rng: np.random.Generator) -> bytearray:
    start = int(rng.integers(len(content)))
    content[start : start + int(rng.integers(0, 6))] = NASTY[rng.integers(len(NASTY))]
    return content


def replace_a_word(content: bytearray, rng: np.random.Generator) -> bytearray:
    words = content.split(b" ")
    words[rng.integers(len(words))] = bytearray(NASTY[rng.integers(len(NASTY))])
    return bytearray(b" ".join(words))


def change_a_number(content: bytearray, rng: np.random.Generator) -> bytearray:
    """Change one digit of the text that a file begins with or consists of."""
    digits = [index for index, byte in enumerate(content) if 48 <= byte <= 57]
    if digits:
        content[digits[rng.integers(len(digits))]] = 48 + int(rng.integers(10))
    return content


def shuffle_lines(content: bytearray, rng: np.random.Generator) -> bytearray:
    lines = content.split(b"\n")
    first, second = rng.integers(len(lines), size=2)
    lines[first], lines[second] = lines[second], lines[first]
    return bytearray(b"\n".join(lines))


INJURIES: list[Injury] = [
    *(flip_bits, flip_bits_of_the_head, cut, delete, repeat, zero, zero_the_tail, noise),
    *(insert_something_nasty, replace_a_word, change_a_number, shuffle_lines),
]
# After one of these alone, a file has lost its end.
ENDINGS = (cut, zero_the_tail)


def injure(name: str, content: bytes, seed: int, index: int) -> tuple[bytes, tuple[str, ...]]:
    """Return one injured file, and the names of its injuries.

    Args:
        name: of the sample; it takes part in the seed.
        content: the good file.
        seed: of the whole series.
        index: number of the file in the series.
    """
    rng = np.random.default_rng([seed, index, *name.encode()])
    # Most injuries of a container end at its lengths and checksums; injured inside and packed anew they go deeper.
    if rng.random() < 0.6 and (inner := _opened(name, content, rng)) is not None:
        part, pack = inner
        injured, done = _injured(part, rng)
        return pack(injured), tuple(f"inner {kind}" for kind in done)
    return _injured(content, rng)


def _injured(content: bytes, rng: np.random.Generator) -> tuple[bytes, tuple[str, ...]]:
    result = bytearray(content)
    done: list[str] = []
    for _ in range(int(rng.integers(1, 3))):
        if result:
            kind = INJURIES[rng.integers(len(INJURIES))]
            result = kind(result, rng)
            done.append(kind.__name__)
    return bytes(result), tuple(done)


def _opened(name: str, content: bytes, rng: np.random.Generator) -> tuple[bytes, Callable[[bytes], bytes]] | None:
    """Return a part of a container, and what puts it back with the right lengths and checksums."""
    if name.endswith(".3mf"):
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            parts: dict[str, bytes | str] = {part: archive.read(part) for part in archive.namelist()}
        chosen = "_rels/.rels" if rng.random() < 0.05 else "3D/3dmodel.model"
        return bytes(parts[chosen]), lambda part: pack_zip({**parts, chosen: part})  # type: ignore[arg-type]
    if name.endswith(".glb"):
        length = struct.unpack_from("<I", content, 12)[0]
        text, binary = content[20 : 20 + length], content[28 + length :]
        if rng.random() < 0.5:
            return text.rstrip(), lambda part: pack_glb(part, binary)
        return binary, lambda part: pack_glb(text.rstrip(), part)
    if name.endswith(".gltf"):
        document = json.loads(content)
        head, _, data = document["buffers"][0]["uri"].partition(",")

        def pack(part: bytes) -> bytes:
            document["buffers"][0] = {"byteLength": len(part), "uri": f"{head},{base64.b64encode(part).decode()}"}
            return json.dumps(document, indent=1).encode()

        return base64.b64decode(data), pack
    return None
