"""Start-up in the one order that works, and the end."""

from __future__ import annotations

import logging
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dmp_viewer import startup
from dmp_viewer.arguments import Arguments, version_text

if TYPE_CHECKING:
    from qtpy.QtGui import QIcon
    from qtpy.QtWidgets import QApplication

_LOG = logging.getLogger("dmp_viewer")


def run(arguments: Arguments) -> int:
    """Show the window and return the exit code: 0 done, 1 our fault, 2 unusable input or surroundings."""
    from dmp.errors import SettingsError
    from dmp.settings import settings_for
    from dmp_viewer import settings as preferences_file

    path = arguments.config or preferences_file.default_path()
    if arguments.list_bindings:
        return _list_bindings(path)
    # What can be refused is refused before seconds of loading.
    reason = startup.missing_display()
    if reason is None:
        reason = _unusable_paths(arguments)
    if reason is None:
        try:
            settings_for(arguments.task, arguments.preset, **arguments.overrides)
        except SettingsError as error:
            reason = str(error)
    if reason is not None:
        return _refuse(reason)
    startup.start_log()
    if arguments.reset_settings:
        path.unlink(missing_ok=True)

    # torch comes before Qt: on Windows its libraries cannot be loaded any more once Qt's are there (WinError 1114).
    import torch

    startup.set_surface_format()
    application = make_application()
    try:
        opengl = startup.probe_opengl()
    except startup.OpenGLMissingError as error:
        return _refuse(str(error))
    if arguments.check:
        device = "cuda" if torch.cuda.is_available() else "cpu"
        print(f"{version_text()}\nOpenGL {opengl.version}: {opengl.renderer}\nTraining on: {device}\nThe window can be shown.")
        return 0
    return _show(arguments, application, opengl)


def make_application() -> QApplication:
    """Return the Qt application, with the name, icon and style of this one."""
    from qtpy.QtWidgets import QApplication

    from dmp_viewer.garbage import GarbageCollection

    application = QApplication(sys.argv[:1])
    application.setApplicationName("dmp-viewer")
    application.setApplicationDisplayName("dmp-viewer")
    application.setDesktopFileName("dmp-viewer")
    # The same on every system, and the style whose colours follow a palette completely.
    application.setStyle("Fusion")
    icon = application_icon()
    if icon is not None:
        application.setWindowIcon(icon)
    garbage = GarbageCollection(application)
    application.aboutToQuit.connect(garbage.close)
    return application


def application_icon() -> QIcon | None:
    """Return the icon of the application, or None when the assets are not there."""
    from qtpy.QtGui import QIcon

    from dmp.errors import MeshError
    from dmp.samples import assets_folder

    try:
        path = assets_folder() / "icons" / "dmp-viewer.png"
    except MeshError:
        return None
    return QIcon(str(path)) if path.is_file() else None


def _show(arguments: Arguments, application: QApplication, opengl: startup.OpenGL) -> int:
    from dmp.settings import settings_for
    from dmp_viewer import settings as preferences_file
    from dmp_viewer.controller import Controller
    from dmp_viewer.keys import bindings
    from dmp_viewer.left_behind import end_process
    from dmp_viewer.picture_job import PictureJob
    from dmp_viewer.shutdown import Shutdown, destroy
    from dmp_viewer.tasks import TASKS
    from dmp_viewer.views.banner import Message
    from dmp_viewer.views.main_window import MainWindow
    from dmp_viewer.views.run_panel import available_devices

    path = arguments.config or preferences_file.default_path()
    preferences = preferences_file.load(path)
    if arguments.theme is not None:
        preferences.theme = arguments.theme
    batch = arguments.screenshot is not None
    if batch:
        # A picture made by a script looks the same whatever a person has chosen before, and changes none of it.
        preferences = preferences_file.Preferences(theme=arguments.theme or "light")
    bound = bindings(preferences.keys)
    window = MainWindow(multi_samples=opengl.multi_samples, tasks=TASKS, devices=available_devices(), keys=bound.keys)
    controller = Controller(window, preferences, None if batch else path)
    for problem in bound.problems:
        controller.say(Message("warning", f"{path}: {problem}"))
    startup.install_hooks(controller.tell_error)
    Shutdown(controller, application)
    settings = settings_for(arguments.task, arguments.preset, **arguments.overrides)
    if arguments.at_step and arguments.at_step % settings.snapshot_every:
        # The last step of a training always has a snapshot, so any step can be asked for.
        settings = replace(settings, steps=arguments.at_step)
    window.panel.set_settings(settings)
    if arguments.size is not None:
        window.resize(*arguments.size)
    window.show()
    job: PictureJob | None = None
    if arguments.screenshot is not None:
        job = PictureJob(controller, arguments.screenshot, arguments.at_step)
    elif arguments.path is None:
        controller.opener.offer_interrupted_run()
        controller.queue.offer_kept()
    if arguments.path is not None:
        controller.opener.open_path(arguments.path, arguments.ground_truth)
        if arguments.start or (arguments.at_step is not None and not arguments.path.is_dir()):
            controller.opener.start_when_opened()
    controller.opener.offer_samples(with_pictures=arguments.path is None)
    if job is not None:
        job.finished.connect(application.exit)
        job.begin(expects_mesh=arguments.path is not None)
    code = application.exec()
    destroy(window)
    if job is not None:
        code = job.exit_code
    end_process(code)
    return code


def _list_bindings(path: Path) -> int:
    from dmp_viewer import settings as preferences_file
    from dmp_viewer.keys import bindings, listing

    bound = bindings(preferences_file.load(path).keys)
    print(listing(bound.keys))
    print(f'\nOther keys: a table “keys” in {path}, such as {{"keys": {{"flip": "Ctrl+Shift+A"}}}}.')
    for problem in bound.problems:
        print(f"dmp-viewer: {path}: {problem}", file=sys.stderr)
    return 0


def _unusable_paths(arguments: Arguments) -> str | None:
    for path in (arguments.path, arguments.ground_truth):
        if path is not None and not path.exists():
            return f"{path}: there is no such file or folder."
    if arguments.config is not None and (arguments.config.is_dir() or not _can_write_beside(arguments.config)):
        return f"{arguments.config}: this cannot be a file of preferences. Name a file in a folder that exists."
    if arguments.screenshot is not None and not _can_write_beside(arguments.screenshot):
        return f"{arguments.screenshot}: the folder {arguments.screenshot.absolute().parent} does not exist."
    return None


def _can_write_beside(path: Path) -> bool:
    return path.absolute().parent.is_dir()


def _refuse(reason: str) -> int:
    print(f"dmp-viewer: {reason}", file=sys.stderr)
    return 2
