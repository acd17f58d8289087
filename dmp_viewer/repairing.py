"""A repaired copy of the open mesh, ready to be shown and trained on. Called off the GUI thread."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dmp.repair import Change, RepairOptions
    from dmp.settings import Settings
    from dmp_viewer.model import Source
    from dmp_viewer.tasks import OpenedMesh

_SUFFIX = " (repaired)"


@dataclass(frozen=True, eq=False)
class RepairedSource:
    """What repair made of an open mesh.

    Attributes:
        opened: the repaired mesh, set up for the task; None when nothing had to be done.
        changes: what was done.
        lost_truth: whether the ground truth does not fit any more.
    """

    opened: OpenedMesh | None
    changes: tuple[Change, ...]
    lost_truth: bool = False


def repair_source(source: Source, options: RepairOptions, settings: Settings) -> RepairedSource:
    """Repair a copy of what is open; the source and its file stay as they are (raises :class:`dmp.errors.MeshError`)."""
    from dmp.repair import repair
    from dmp_viewer.holes import find_holes
    from dmp_viewer.tasks import set_up

    repaired = repair(source.mesh, options)
    if not repaired.changes:
        return RepairedSource(None, ())
    # A truth for denoising has the faces of the mesh as it was; one for holes is a surface of its own.
    truth = source.ground_truth if settings.task == "complete" else None
    copy = replace(
        source,
        name=source.name.removesuffix(_SUFFIX) + _SUFFIX,
        mesh=repaired.mesh,
        ground_truth=truth,
        ground_truth_path=source.ground_truth_path if truth is not None else None,
        path=None,
        holes=find_holes(repaired.mesh),
    )
    return RepairedSource(set_up(copy, settings), repaired.changes, source.ground_truth is not None and truth is None)
