"""Makes the pictures of the documentation, in the real window: `python scripts/pictures.py [NAME …]`.

Without a display it starts itself again under xvfb-run. The pictures of the dragon need the folder ``dragon_hole`` (or
``--dragon FOLDER``) with ``filled.obj``, a mesh whose hole was filled, and ``inserted_vertices.txt``, the vertices that were
inserted; they are taken out, the hole is completed by the command line, and the result is shown. Nothing of that mesh enters
the project. All of it takes about ten minutes on two processor cores.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from qtpy.QtGui import QPixmap

    from dmp.settings import Settings
    from dmp_viewer.controller import Controller

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
MOST_BYTES = 400_000
SIZE = (1600, 1000)
# Height of the row of colours that the palette has to hold, pixels.
_ROW = 120
DRAGON = ROOT.parent / "shared" / "meshes" / "dragon_hole"


class Stage:
    """One window, made for a picture and closed afterwards."""

    def __init__(self, runs_folder: Path, theme: str = "light", size: tuple[int, int] = SIZE) -> None:
        from dmp_viewer.controller import Controller
        from dmp_viewer.settings import Preferences
        from dmp_viewer.tasks import TASKS
        from dmp_viewer.views.main_window import MainWindow

        window = MainWindow(multi_samples=_multi_samples(), tasks=TASKS)
        window.resize(*size)
        self.controller: Controller = Controller(window, Preferences(theme=theme), None, runs_folder)
        window.show()

    def __enter__(self) -> Controller:
        return self.controller

    def __exit__(self, *_: object) -> None:
        controller = self.controller
        controller.window.close_guard = lambda: True
        controller.background.close()
        controller.scanner.close()
        controller.comparing.close()
        controller.presenter.close()
        controller.window.close()


def pump(seconds: float) -> None:
    """Let the window live for a while."""
    from qtpy.QtCore import QCoreApplication

    end = time.monotonic() + seconds
    while time.monotonic() < end:
        QCoreApplication.processEvents()
        time.sleep(0.005)


def settle(controller: Controller) -> None:
    """Wait until everything is read and drawn."""
    if not controller.background.wait(300):
        raise SystemExit("Opening a mesh takes too long.")
    controller.presenter.flush()
    pump(0.6)
    controller.scanner.wait(60)
    controller.window.banners.clear()
    controller.presenter.flush()
    pump(0.3)


def train(controller: Controller, settings: Settings, step: int) -> None:
    """Train until a step and stay there, as a person would who pauses."""
    controller.window.panel.set_settings(settings)
    controller.presenter.flush()
    controller.start()
    while step not in controller.workspace.snapshot_steps:
        pump(0.1)
        if not controller.runner.state.is_active and controller.workspace.run is not None:
            break
    controller.runner.pause()
    settle(controller)


def save(picture: QPixmap, name: str) -> None:
    """Write a picture with as few colours as it takes to stay small."""
    from PIL import Image

    IMAGES.mkdir(parents=True, exist_ok=True)
    path = IMAGES / f"{name}.png"
    picture.save(str(path))
    image = Image.open(path).convert("RGB")
    # Thin lines have too few pixels to get colours of their own, so each colour of the theme is given some.
    weighted = Image.new("RGB", (image.width, image.height + _ROW))
    weighted.paste(image, (0, 0))
    colors = theme_colors()
    width = image.width / len(colors)
    for index, color in enumerate(colors):
        weighted.paste(color, (round(index * width), image.height, round((index + 1) * width), image.height + _ROW))
    for count in (256, 192, 128):
        palette = weighted.quantize(count, kmeans=1)
        image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)
        if path.stat().st_size < MOST_BYTES:
            break
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


def theme_colors() -> list[str]:
    """Return the colours of lines and markers in both themes."""
    from dmp_viewer.theme import DARK, LIGHT

    return [
        color
        for theme in (LIGHT, DARK)
        for color in (theme.hole, theme.pointed, theme.kept, theme.suggested, theme.best, theme.accent, *theme.curves.values())
    ]


def whole_window(controller: Controller) -> QPixmap:
    """Return a picture of the window."""
    return controller.exporter.picture()


def one_pane(controller: Controller, index: int) -> QPixmap:
    """Return a picture of one pane with its title."""
    panes = controller.window.panes
    left, top = panes.mapTo(controller.window, panes.rect().topLeft()).toTuple()
    width = panes.width() // 3
    return whole_window(controller).copy(left + index * width, top, width - 1, panes.height())


def window(folder: Path, theme: str, sample: str) -> QPixmap:
    """A noisy sample in training."""
    from dmp.settings import settings_for

    with Stage(folder, theme) as controller:
        controller.opener.open_sample(sample)
        settle(controller)
        train(controller, settings_for("denoise"), 400)
        picture = whole_window(controller)
        controller.runner.stop()
        controller.runner.wait(30)
    return picture


def completion(folder: Path) -> QPixmap:
    """The sample with holes, completed."""
    from dmp.settings import settings_for

    with Stage(folder) as controller:
        controller.opener.open_sample("holed-bumpy-sphere")
        settle(controller)
        settings = settings_for("complete")
        train(controller, settings, settings.steps)
        listed = controller.window.panel.hole_section.holes.table
        listed.setCurrentIndex(listed.model().index(0, 0))
        controller.hole_control.look_at(0)
        settle(controller)
        return whole_window(controller)


def dragon(folder: Path, meshes: Path) -> dict[str, QPixmap]:
    """The hole of the dragon: open, filled, and completed by the command line."""
    from dmp.mesh import TriangleMesh
    from dmp.meshio import read_mesh, write_mesh
    from dmp.settings import settings_for
    from dmp_viewer.views.mesh_panes import INPUT, PREDICTED

    filled = read_mesh(meshes / "filled.obj")
    inserted = np.loadtxt(meshes / "inserted_vertices.txt", dtype=np.int64)
    stays = np.ones(filled.n_vertices, dtype=bool)
    stays[inserted] = False
    faces = filled.faces[stays[filled.faces].all(axis=1)]
    path, run = folder / "dragon.ply", folder / "dragon-run"
    write_mesh(path, TriangleMesh(filled.vertices[stays], (np.cumsum(stays) - 1)[faces]))
    command = [sys.executable, "-m", "dmp", "complete", str(path), "-o", str(folder / "out.ply"), "--run", str(run)]
    started = time.monotonic()
    subprocess.run([*command, "--quiet"], check=True, cwd=ROOT)
    print(f"The dragon was completed in {time.monotonic() - started:.0f} s.")
    pictures = {}
    with Stage(folder, size=(1600, 760)) as controller:
        controller.window.set_panel_visible(False)
        controller.window.set_curve_visible(False)
        controller.window.panel.set_settings(settings_for("complete"))
        controller.opener.open_path(run)
        settle(controller)
        controller.workspace.colors.set(quantity="plain")
        controller.hole_control.look_at(min(controller.workspace.holes.filled))
        controller.workspace.holes.point_at(None)
        settle(controller)
        pictures["dragon-before"] = one_pane(controller, INPUT)
        pictures["dragon-completed"] = one_pane(controller, PREDICTED)
        controller.workspace.set_filling_only(True)
        settle(controller)
        pictures["dragon-filled"] = one_pane(controller, PREDICTED)
    return pictures


def make(wanted: Sequence[str], meshes: Path) -> None:
    """Make the pictures with these names."""
    import torch  # noqa: F401  # before Qt, as in the application

    from dmp_viewer import startup
    from dmp_viewer.app import make_application

    startup.set_surface_format()
    application = make_application()
    startup.probe_opengl()
    pictures: dict[str, Callable[[Path], QPixmap]] = {
        "window": lambda folder: window(folder, "light", "bumpy-sphere"),
        "window-dark": lambda folder: window(folder, "dark", "fan-block"),
        "completion": completion,
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, picture in pictures.items():
            if name in wanted:
                save(picture(Path(folder)), name)
        if "dragon" in wanted and not (meshes / "filled.obj").is_file():
            print(f"No pictures of the dragon: {meshes} does not have its mesh. Name its folder with --dragon.")
        elif "dragon" in wanted:
            for name, made in dragon(Path(folder), meshes).items():
                save(made, name)
    application.quit()


def _multi_samples() -> int:
    from dmp_viewer import startup

    return startup.probe_opengl().multi_samples


def main() -> int:
    """Read the command line and make the pictures."""
    names = ("window", "window-dark", "completion", "dragon")
    parser = argparse.ArgumentParser(description="Make the pictures of the documentation.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which pictures: {', '.join(names)} (default: all)")
    parser.add_argument("--dragon", type=Path, default=DRAGON, help="folder with filled.obj and inserted_vertices.txt")
    arguments = parser.parse_args()
    unknown = set(arguments.names) - set(names)
    if unknown:
        parser.error(f"there is no picture named {', '.join(sorted(unknown))}; choose from {', '.join(names)}")
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        server = shutil.which("xvfb-run")
        if server is None:
            print("There is no display, and xvfb-run is not installed.", file=sys.stderr)
            return 2
        screen = ["-a", "-s", f"-screen 0 {SIZE[0] + 100}x{SIZE[1] + 100}x24"]
        return subprocess.run([server, *screen, sys.executable, *sys.argv], check=False).returncode
    sys.path.insert(0, str(ROOT))
    make(arguments.names or names, arguments.dragon)
    return 0


if __name__ == "__main__":
    sys.exit(main())
