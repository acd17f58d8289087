"""Which key does what: those of the table of actions, and what the preferences say otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from qtpy.QtCore import Qt
from qtpy.QtGui import QKeySequence

from dmp_viewer.actions import ACTIONS, MENUS, ActionSpec

_BARE = (Qt.Key.Key_unknown, Qt.Key.Key_Control, Qt.Key.Key_Shift, Qt.Key.Key_Alt, Qt.Key.Key_Meta)


@dataclass(frozen=True)
class Bindings:
    """The keys in force.

    Attributes:
        keys: key of each action by name, as Qt writes it; several are parted by ``; ``, and none is empty.
        problems: sentences about what the preferences say and cannot be.
    """

    keys: dict[str, str]
    problems: tuple[str, ...] = ()


def bindings(wanted: Mapping[str, Any]) -> Bindings:
    """Return the keys when the preferences want some to be others.

    A key that is given to another action is taken from the one that has it otherwise.

    Args:
        wanted: keys by name of the action, such as ``{"flip": "Ctrl+Shift+A"}``; an empty one takes the key away. Entries that
            cannot be are left out, and told.
    """
    keys = {spec.name: spec.key for spec in ACTIONS}
    chosen: dict[str, str] = {}
    problems: list[str] = []
    for name, text in wanted.items():
        if name not in keys:
            problems.append(f"There is no action “{name}” that could have a key; “dmp-viewer --list-bindings” lists all.")
        elif not isinstance(text, str) or not _are_keys(text):
            problems.append(f"“{text}” is no key for the action “{name}”. Keys are written like F, F5, Ctrl+F or Shift+Left.")
        elif taken := {key: other for other, own in chosen.items() for key in _parts(own)}.keys() & set(_parts(text)):
            key = sorted(taken)[0]
            other = next(other for other, own in chosen.items() if key in _parts(own))
            problems.append(f"The key {key} is given to “{other}” and to “{name}”; it stays with “{other}”.")
        else:
            chosen[name] = "; ".join(_parts(text))
    given = {key for text in chosen.values() for key in _parts(text)}
    for name, text in keys.items():
        keys[name] = chosen.get(name, "; ".join(key for key in _parts(text) if key not in given))
    return Bindings(keys, tuple(problems))


def sequences(text: str) -> list[QKeySequence]:
    """Return keys as Qt takes them."""
    return QKeySequence.listFromString(text) if text else []


def key_text(text: str) -> str:
    """Return keys as this system writes them."""
    return " or ".join(key.toString(QKeySequence.SequenceFormat.NativeText) for key in sequences(text))


def what(spec: ActionSpec) -> str:
    """Return in a few words what an action does, with the menu that it stands in when that says more."""
    text = spec.text.replace("&", "").rstrip("…")
    return f"{spec.submenu.replace('&', '')}: {text}" if spec.submenu else text


def keys_table(keys: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return (menu, what, key) for everything that has a key, in the order of the menus."""
    return [
        (MENUS[spec.menu].replace("&", ""), what(spec), key_text(keys[spec.name])) for spec in ACTIONS if keys.get(spec.name)
    ]


def listing(keys: Mapping[str, str]) -> str:
    """Return all actions, a line each: name, key, and what it does."""
    rows = [(spec.name, keys[spec.name] or "-", f"{MENUS[spec.menu].replace('&', '')} > {what(spec)}") for spec in ACTIONS]
    wide = [max(len(row[column]) for row in rows) for column in (0, 1)]
    return "\n".join(f"{name:{wide[0]}}  {key:{wide[1]}}  {text}" for name, key, text in rows)


def _parts(text: str) -> list[str]:
    return [key.toString() for key in sequences(text)]


def _are_keys(text: str) -> bool:
    """Tell whether each part of a text is one key, with or without Ctrl, Shift, Alt or Meta."""
    if not text:
        return True
    found = sequences(text)
    return len(found) == len(text.split("; ")) and all(
        key.count() == 1 and key[0].key() not in _BARE and bool(key.toString()) for key in found
    )
