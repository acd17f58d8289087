"""Strict access to a JSON document from a stranger: bounded in size, and each value of the type that is asked for."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NoReturn

from dmp.formats.source import FormatError
from dmp.formats.text import show

# Each value takes about 100 bytes once it is read; long strings (data within the text) are no values.
_MAXIMUM_VALUES = 1_000_000
_RESAVE = "Save or copy the file again from where it came from."


@dataclass(frozen=True)
class Item:
    """A JSON object, and where it stands, such as "node 3"."""

    values: dict[str, Any]
    where: str

    def has(self, key: str) -> bool:
        """Tell whether the object has that key."""
        return key in self.values

    def unknown(self, known: frozenset[str]) -> str | None:
        """Return the first key that is not one of ``known``, for a message, or None."""
        return next((show(key.encode(errors="replace")) for key in self.values if key not in known), None)

    def integer(self, key: str, default: int | None = None, *, largest: int = 2**53) -> int:
        """Return a whole number from 0 to ``largest``.

        Raises:
            FormatError: when it is missing and there is no default, or is anything else.
        """
        value = self.values.get(key, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= largest:
            self._refuse(key, "a whole number that is possible here")
        return value

    def flag(self, key: str) -> bool:
        """Return true or false; false when it is missing."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            self._refuse(key, "true or false")
        return value

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text."""
        value = self.values.get(key, default)
        if not isinstance(value, str):
            self._refuse(key, "a text")
        return value

    def numbers(self, key: str, n: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """Return ``n`` finite numbers."""
        value = self.values.get(key, default)
        if not isinstance(value, list | tuple) or len(value) != n or not all(_is_finite(number) for number in value):
            self._refuse(key, f"a list of {n} finite numbers")
        return tuple(float(number) for number in value)

    def indices(self, key: str) -> tuple[int, ...]:
        """Return a list of whole numbers of at least 0; empty when it is missing."""
        value = self.values.get(key, [])
        if not isinstance(value, list) or not all(type(index) is int and index >= 0 for index in value):
            self._refuse(key, "a list of numbers of entries")
        return tuple(value)

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts; empty when it is missing."""
        value = self.values.get(key, [])
        if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
            self._refuse(key, "a list of texts")
        return tuple(value)

    def item(self, key: str) -> Item:
        """Return an object; an empty one when it is missing."""
        value = self.values.get(key, {})
        if not isinstance(value, dict):
            self._refuse(key, "an object")
        return Item(value, f"{self.where}, {key}")

    def items(self, key: str, name: str) -> Iterator[Item]:
        """Yield the objects of a list; each is called ``name`` and its number."""
        for index in range(self.n_items(key)):
            yield self.entry(key, index, name)

    def n_items(self, key: str) -> int:
        """Return how many entries a list has; 0 when it is missing."""
        value = self.values.get(key, [])
        if not isinstance(value, list):
            self._refuse(key, "a list")
        return len(value)

    def entry(self, key: str, index: int, name: str) -> Item:
        """Return one object of a list.

        Raises:
            FormatError: when there are not so many, or it is no object.
        """
        n = self.n_items(key)
        if index >= n:
            raise FormatError(f"{self.where}: '{key}' has {n:,} entries, but number {index:,} is asked for", _RESAVE)
        value = self.values[key][index]
        if not isinstance(value, dict):
            raise FormatError(f"{self.where}: {name} {index:,} is no object", _RESAVE)
        return Item(value, f"{name} {index:,}")

    def _refuse(self, key: str, what: str) -> NoReturn:
        missing = "is missing; it should be" if key not in self.values else "is not"
        raise FormatError(f"{self.where}: '{key}' {missing} {what}", _RESAVE)


def parse_json(text: bytes, where: str, first_byte: int | None = None) -> Item:
    """Read a JSON document.

    Args:
        text: the document in UTF-8.
        where: what to call it in messages.
        first_byte: where it begins in a file that is no text, so that messages tell bytes instead of lines.

    Raises:
        FormatError: when it is not JSON, is no object, names a key twice, or has more than a million values.
    """
    if text.count(b",") + text.count(b"[") + text.count(b"{") > _MAXIMUM_VALUES:
        raise FormatError(f"{where} has more than {_MAXIMUM_VALUES:,} values", "Save only the part of it that you need.")
    try:
        document = json.loads(text.decode("utf-8"), object_pairs_hook=_without_repetitions, parse_constant=_no_number)
    except UnicodeDecodeError as error:
        raise FormatError(f"{where} is no UTF-8 text (byte {(first_byte or 0) + error.start:,})", _RESAVE) from error
    except json.JSONDecodeError as error:
        if first_byte is None:
            place = f"line {error.lineno:,}, column {error.colno:,}"
        else:
            place = f"byte {first_byte + len(error.doc[: error.pos].encode()):,}"
        raise FormatError(f"{place}: {where} is damaged: {error.msg.rstrip('.')}", _RESAVE) from error
    except RecursionError as error:
        raise FormatError(f"{where} is nested too deeply", _RESAVE) from error
    except ValueError as error:  # a whole number of thousands of digits
        raise FormatError(f"{where} holds a number that is too long", _RESAVE) from error
    if not isinstance(document, dict):
        raise FormatError(f"{where} is no JSON object", _RESAVE)
    return Item(document, where)


def _without_repetitions(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        seen: set[str] = set()
        key = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise FormatError(f"the JSON text gives '{show(key.encode(errors='replace'))}' twice in one object", _RESAVE)
    return result


def _no_number(name: str) -> NoReturn:
    raise FormatError(f"the JSON text holds '{name}', which is not a finite number", _RESAVE)


def _is_finite(value: object) -> bool:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False
