"""Makes the pictures of docs/guide.md, in the real window: `python scripts/guide_pictures.py [NAME …]`.

Without a display it starts itself again under xvfb-run. The runs that it shows are trained first by the command line, which
takes about ten minutes on two processor cores; `--runs FOLDER` keeps them there and uses those that are there already.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pictures
from pictures import ROOT, SIZE, Stage, pump, settle

if TYPE_CHECKING:
    from PIL.Image import Image
    from qtpy.QtWidgets import QWidget

    from dmp_viewer.controller import Controller

MOST_BYTES = 200_000
# Whole windows are shown smaller than they are: the text of a page is no wider.
_PAGE_WIDTH = 1180
_ASSETS = ROOT / "assets"
_RUNS: dict[str, list[str]] = {
    "bumpy": ["denoise", "bumpy-sphere-noisy.ply", "--ground-truth", "bumpy-sphere.ply", "--steps", "800"],
    "holed": ["complete", "holed-bumpy-sphere.ply", "--ground-truth", "bumpy-sphere.ply", "--steps", "200",
              "--snapshot-every", "20"],
}  # fmt: skip


def train(folder: Path) -> None:
    """Train the runs that are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (task, mesh, option, truth, *more) in _RUNS.items():
        if not (folder / name).is_dir():
            command = [sys.executable, "-m", "dmp", task, str(_ASSETS / mesh), option, str(_ASSETS / truth), *more]
            subprocess.run([*command, "--run", str(folder / name), "-o", str(folder / f"{name}.ply")], check=True, cwd=ROOT)


def image_of(widget: QWidget) -> Image:
    """Return what a widget shows."""
    import numpy as np
    from PIL import Image
    from qtpy.QtGui import QImage

    grabbed = widget.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(grabbed.constBits(), dtype=np.uint8).reshape(grabbed.height(), grabbed.bytesPerLine())
    return Image.fromarray(rows[:, : 3 * grabbed.width()].reshape(grabbed.height(), grabbed.width(), 3).copy())


def part(controller: Controller, *widgets: QWidget, margin: int = 6) -> Image:
    """Return the part of the window that some of its widgets take."""
    window = controller.window
    whole = image_of(window)
    corners = [(widget.mapTo(window, widget.rect().topLeft()), widget.size()) for widget in widgets]
    left, top = min(place.x() for place, _ in corners), min(place.y() for place, _ in corners)
    right = max(place.x() + size.width() for place, size in corners)
    bottom = max(place.y() + size.height() for place, size in corners)
    ratio = whole.width / window.width()
    box = (
        max(0, left - margin),
        max(0, top - margin),
        min(window.width(), right + margin),
        min(window.height(), bottom + margin),
    )
    return whole.crop(tuple(round(ratio * side) for side in box))


def pane(controller: Controller, index: int) -> Image:
    """Return one pane with its title."""
    panes = part(controller, controller.window.panes, margin=0)
    return panes.crop((round(index * panes.width / 3), 0, round((index + 1) * panes.width / 3), panes.height))


def row(images: Sequence[Image], gap: int = 10) -> Image:
    """Return pictures side by side."""
    from PIL import Image

    height = max(image.height for image in images)
    joined = Image.new("RGB", (sum(image.width for image in images) + gap * (len(images) - 1), height), "white")
    left = 0
    for image in images:
        joined.paste(image, (left, 0))
        left += image.width + gap
    return joined


def save(image: Image, name: str) -> None:
    """Write a picture with as few colours, and if need be as small, as it takes to weigh little."""
    from PIL import Image as Images

    path = pictures.IMAGES / f"guide-{name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    width = min(image.width, _PAGE_WIDTH)
    while True:
        shown = image.resize((width, round(image.height * width / image.width)), Images.Resampling.LANCZOS)
        for count in (256, 160):
            shown.quantize(palette=_palette(shown, count), dither=Images.Dither.NONE).save(path, optimize=True)
            if path.stat().st_size < MOST_BYTES:
                print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB, {shown.width} x {shown.height}")
                return
        width = round(0.9 * width)


def _palette(image: Image, count: int) -> Image:
    """Return the colours for a picture: lines have too few pixels to get some of their own, so they are given more."""
    import numpy as np
    from PIL import Image as Images

    from dmp.exports.color_tables import color_table

    tables = [color_table(name)[8::16, :3] * share for name in ("magnitude", "signed") for share in (1.0, 0.75)]
    seen = {tuple(color) for color in np.asarray(image).reshape(-1, 3)[::7].tolist()}
    named = [Images.new("RGB", (1, 1), color).getpixel((0, 0)) for color in pictures.theme_colors()]
    colors = [tuple(round(c) for c in color) for table in tables for color in table.tolist()] + named
    # Only what occurs in the picture, or nearly.
    near = np.array(sorted(seen), dtype=int)
    wanted = [color for color in colors if np.abs(near - np.array(color)).max(axis=1).min() <= 12]
    room = max(1, image.height // 10)
    weighted = Images.new("RGB", (image.width, image.height + room))
    weighted.paste(image, (0, 0))
    for index, color in enumerate(wanted):
        left, right = (round(image.width * place / len(wanted)) for place in (index, index + 1))
        weighted.paste(color, (left, image.height, right, image.height + room))
    return weighted.quantize(count, kmeans=1)


# -- the pictures ---------------------------------------------------------------------------------------------------------


def start_page(runs: Path, made: Path) -> dict[str, Image]:
    """The page that opens first, and what a damaged mesh has to say."""
    import numpy as np

    from dmp.mesh import TriangleMesh
    from dmp.meshio import read_mesh, write_mesh

    found = {}
    with Stage(made, size=(1280, 800)) as controller:
        controller.opener.offer_samples(with_pictures=True)
        settle(controller)
        found["start"] = image_of(controller.window)
    mesh = read_mesh(_ASSETS / "fan-block-noisy.ply")
    # Some faces turned round, one doubled, and a crumb far off.
    faces = mesh.faces.copy()
    faces[100:108] = faces[100:108, ::-1]
    crumb = mesh.vertices[faces[0]] * 0.02 + mesh.vertices.max(axis=0)
    broken = TriangleMesh(
        np.concatenate([mesh.vertices, crumb]), np.concatenate([faces, faces[:1], [[mesh.n_vertices + k for k in range(3)]]])
    )
    write_mesh(made / "scan.ply", broken)
    with Stage(made, size=(1280, 800)) as controller:
        controller.opener.open_path(made / "scan.ply")
        settle(controller)
        controller.report.open_report()
        pump(0.5)
        assert controller.report.dialog is not None
        found["mesh-report"] = image_of(controller.report.dialog)
    return found


def denoised(runs: Path, made: Path) -> dict[str, Image]:
    """Everything about a run that removed noise."""
    from qtpy.QtCore import QPoint

    from dmp_viewer.comparing import run_filter

    found: dict[str, Image] = {}
    with Stage(made) as controller:
        window, workspace = controller.window, controller.workspace
        controller.opener.open_path(runs / "bumpy")
        settle(controller)
        workspace.show_step(300)
        for step in {100, 500} - set(workspace.bookmarks.steps):
            workspace.bookmarks.switch(step)
        workspace.look.set(up="z")
        settle(controller)
        pump(1.5)
        settle(controller)
        found["window"] = image_of(window)
        found["curve"] = part(controller, window.curve)
        found["timeline"] = part(controller, window.timeline)
        found["colour-bar"] = part(controller, window.color_bar)
        for mode in ("swipe", "lens"):
            workspace.comparison.set_mode(mode)
            settle(controller)
            found[mode] = pane(controller, 2)
        workspace.comparison.set_mode("off")
        shown = []
        for quantity in ("signed", "error", "curvature", "normals"):
            workspace.colors.set(quantity=quantity)
            settle(controller)
            shown.append(pane(controller, 2))
        found["colours"] = row(shown)
        workspace.colors.set(quantity="error")
        panes = window.panes
        place = QPoint(round(panes.interactor.width() * 5 / 6), panes.interactor.height() // 2)
        workspace.picking.pick(panes.vertex_at(place))
        settle(controller)
        pump(1.5)
        settle(controller)
        found["picked"] = part(controller, window.panes, window.picked)
        workspace.picking.pick(None)
        assert workspace.problem is not None
        filtered = run_filter(workspace.problem, "taubin", {})
        workspace.comparison.set_filtered(filtered.title, filtered.details, filtered.positions)
        settle(controller)
        found["filter"] = part(controller, window.panes)
        controller.exports.open_dialog()
        dialog = controller.exports.dialog
        assert dialog is not None
        dialog.choose(dialog.picture)
        pump(0.3)
        first = image_of(dialog)
        dialog.choose(dialog.animation)
        pump(0.3)
        found["export"] = row([first, image_of(dialog)])
        dialog.close()
    found["judging"] = row([found.pop("swipe"), found.pop("lens")])
    return found


def completed(runs: Path, made: Path) -> dict[str, Image]:
    """A run that filled holes."""
    with Stage(made) as controller:
        controller.opener.open_path(runs / "holed")
        settle(controller)
        controller.workspace.look.set(up="z")
        controller.hole_control.look_at(0)
        settle(controller)
        pump(1.0)
        settle(controller)
        return {"holes": image_of(controller.window)}


def run_list(runs: Path, made: Path) -> dict[str, Image]:
    """The list of runs and the queue."""
    folder = made / "kept"
    for name in _RUNS:
        shutil.copytree(runs / name, folder / name)
    with Stage(folder) as controller:
        controller.opener.open_path(folder / "bumpy")
        settle(controller)
        controller.window.named_actions["show_runs"].trigger()
        pump(2.0)
        settle(controller)
        # The thumbnails have found their new places, and are drawn one by one.
        pump(4.0)
        return {"runs": image_of(controller.window)}


GROUPS: dict[str, Callable[[Path, Path], dict[str, Image]]] = {
    "start": start_page, "denoised": denoised, "completed": completed, "runs": run_list,
}  # fmt: skip


def make(wanted: Sequence[str], runs: Path) -> None:
    """Make the pictures of these groups."""
    import torch  # noqa: F401  # before Qt, as in the application

    from dmp_viewer import startup
    from dmp_viewer.app import make_application

    startup.set_surface_format()
    application = make_application()
    startup.probe_opengl()
    for name in wanted:
        with tempfile.TemporaryDirectory() as folder:
            for picture, image in GROUPS[name](runs, Path(folder)).items():
                save(image, picture)
    application.quit()


def main() -> int:
    """Read the command line and make the pictures."""
    parser = argparse.ArgumentParser(description="Make the pictures of docs/guide.md.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which of {', '.join(GROUPS)} (default: all)")
    parser.add_argument("--runs", type=Path, help="folder for the runs that are shown; those that are there are used again")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(GROUPS):
        parser.error(f"there is no '{sorted(unknown)[0]}'; choose from {', '.join(GROUPS)}")
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        server = shutil.which("xvfb-run")
        if server is None:
            print("There is no display, and xvfb-run is not installed.", file=sys.stderr)
            return 2
        screen = ["-a", "-s", f"-screen 0 {SIZE[0] + 100}x{SIZE[1] + 100}x24"]
        return subprocess.run([server, *screen, sys.executable, *sys.argv], check=False).returncode
    sys.path.insert(0, str(ROOT))
    with tempfile.TemporaryDirectory() as folder:
        runs = arguments.runs or Path(folder)
        train(runs)
        make(arguments.names or list(GROUPS), runs.absolute())
    return 0


if __name__ == "__main__":
    sys.exit(main())
