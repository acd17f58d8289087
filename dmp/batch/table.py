"""Tables of jobs: CSV files with a row for each mesh and settings."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dmp.batch.jobs import BatchJob, job_for
from dmp.errors import MeshFileError, SettingsError
from dmp.files import in_words
from dmp.settings import SETTING_FIELDS, Settings, check, default_preset, presets_for, setting_value, settings_for

_OF_FILES = ("mesh", "ground_truth", "name", "settings")
# The file of a spreadsheet, not of a disk gone mad.
_MOST_BYTES = 64 * 1024**2


def jobs_from_table(path: Path, settings: Settings, changes: Mapping[str, Any]) -> list[BatchJob]:
    """Return the jobs of a CSV table.

    Its first line names the columns: ``mesh``; and, if wanted, ``ground_truth``, ``name``, any setting by its name (such as
    ``preset``, ``steps``, ``seed`` or ``task``), and ``settings`` with ``NAME=VALUE`` pairs separated by semicolons. An empty
    cell leaves a setting as it is on the command line. Paths are meant from the folder of the table.

    Args:
        path: the table.
        settings: of rows that say nothing else.
        changes: the settings that were named on the command line.

    Raises:
        MeshFileError: when the table cannot be read, or a file in it is missing; the text names the line.
        SettingsError: for a wrong value; the text names the line.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise MeshFileError(path, "this is too large for a table of jobs", "Divide it.")
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise MeshFileError(path, "this is no UTF-8 text", "Save the table as CSV, UTF-8.") from error
    except OSError as error:
        raise MeshFileError(path, f"it cannot be read: {in_words(error)}", "Name another file.") from error
    lines = text.splitlines()
    # A spreadsheet in some countries writes semicolons, because the comma is taken.
    delimiter = max(",;\t", key=lines[0].count) if lines else ","
    rows = csv.DictReader(lines, delimiter=delimiter, skipinitialspace=True)
    try:
        columns = [_column(name) for name in rows.fieldnames or ()]
        _check_columns(path, columns)
        rows.fieldnames = columns
        return [
            _job(path, rows.line_num, row, settings, changes) for row in rows if any((value or "") for value in _cells(row))
        ]
    except csv.Error as error:
        raise MeshFileError(path, f"line {rows.line_num} is no line of a CSV table: {error}", "Correct it.") from error


def _column(name: str | None) -> str:
    return (name or "").strip().lower().removeprefix("--").replace("-", "_").replace(" ", "_")


def _cells(row: Mapping[str, Any]) -> list[str]:
    return [value.strip() for value in row.values() if isinstance(value, str)]


def _check_columns(path: Path, columns: list[str]) -> None:
    if "mesh" not in columns:
        raise MeshFileError(path, "no column is named 'mesh'", "Its first line must name the columns, such as: mesh,steps,seed")
    for name in columns:
        if name not in _OF_FILES and name not in SETTING_FIELDS:
            raise MeshFileError(
                path,
                f"there is no setting '{name}' for a column",
                f"Columns are {', '.join(_OF_FILES)}, and settings as in 'dmp denoise --help'.",
            )
        if columns.count(name) > 1:
            raise MeshFileError(path, f"two columns are named '{name}'", "Leave one of them out.")


def _job(path: Path, line: int, row: Mapping[str, Any], settings: Settings, changes: Mapping[str, Any]) -> BatchJob:
    if None in row or any(value is None for value in row.values()):
        raise MeshFileError(path, f"line {line} has another number of cells than the first line", "Correct it.")
    cells = {name: value.strip() for name, value in row.items()}
    if not cells["mesh"]:
        raise MeshFileError(path, f"line {line} names no mesh", "Fill in its cell, or leave the line out.")
    try:
        truth = cells.get("ground_truth")
        return job_for(
            path.parent / cells["mesh"],
            _settings(cells, settings, changes),
            path.parent / truth if truth else None,
            cells.get("name") or None,
        )
    except SettingsError as error:
        raise SettingsError(f"{path}, line {line}: {error}") from error
    except MeshFileError as error:
        raise MeshFileError(path, f"line {line} names {error.path}: {error.cause}", error.remedy) from error


def _settings(cells: Mapping[str, str], usual: Settings, changes: Mapping[str, Any]) -> Settings:
    said = {name: cells[name] for name in cells if name in SETTING_FIELDS and cells[name]}
    for pair in filter(None, (text.strip() for text in cells.get("settings", "").split(";"))):
        name, separator, value = pair.partition("=")
        name = _column(name)
        if not separator or name not in SETTING_FIELDS:
            raise SettingsError(f"'{pair}' must be NAME=VALUE with the name of a setting, such as steps=200.")
        said[name] = value.strip()
    values = {name: check(name, setting_value(text)) for name, text in said.items()}
    task = values.pop("task", usual.task)
    named = {name: value for name, value in changes.items() if name != "preset"}
    kept = usual.preset if task == usual.task and usual.preset in presets_for(task) else default_preset(task)
    return settings_for(task, values.pop("preset", changes.get("preset") or kept), **{**named, **values})
