"""What has to be right before there is a window: display, OpenGL, log file, and hooks that lose no error."""

from __future__ import annotations

import ctypes
import logging
import logging.handlers
import os
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import platformdirs

_LOG = logging.getLogger("dmp_viewer")
_COMMAND_LINE = "On this machine use the command line instead: dmp denoise MESH -o OUT"
_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swiftshader", "software")


def log_path() -> Path:
    """Return the file that messages of Qt and unexpected errors are written to."""
    return platformdirs.user_log_path("dmp-viewer", appauthor=False) / "dmp-viewer.log"


def start_log() -> None:
    """Write warnings and errors to the log file; without one the program works all the same."""
    _LOG.setLevel(logging.INFO)
    # A log that cannot be written, as on a full disk, is no reason to print a traceback for each of its lines.
    logging.raiseExceptions = False
    try:
        log_path().parent.mkdir(parents=True, exist_ok=True)
        handler = logging.handlers.RotatingFileHandler(
            log_path(), maxBytes=500_000, backupCount=1, encoding="utf-8", delay=True
        )
    except OSError:
        return
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    _LOG.addHandler(handler)


def missing_display() -> str | None:
    """Return one line that says why no window can be shown and what to do, or None when nothing speaks against it.

    Qt itself ends the process with an abort where it finds no display, so this is asked before.
    """
    if sys.platform in ("win32", "darwin", "cygwin"):
        return None
    platform = os.environ.get("QT_QPA_PLATFORM", "").split(":")[0]
    if platform and platform not in ("xcb", "wayland", "wayland-egl"):
        return f"The window needs OpenGL, which Qt's platform '{platform}' does not give. {_COMMAND_LINE}"
    wayland = bool(os.environ.get("WAYLAND_DISPLAY")) and platform != "xcb"
    display = os.environ.get("DISPLAY", "")
    if not wayland and not display:
        return f"There is no display to show a window on (DISPLAY is not set). {_COMMAND_LINE}"
    if not wayland and not _answers(display):
        return f"The display {display} does not answer. {_COMMAND_LINE}"
    if not wayland and not _library_is_there("libxcb-cursor.so.0"):
        return f"Qt needs the system library libxcb-cursor0 (Debian, Ubuntu: sudo apt install libxcb-cursor0). {_COMMAND_LINE}"
    return None


def _answers(display: str) -> bool:
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:
        return True  # nothing to ask with; Qt brings its own way to the display
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XOpenDisplay.argtypes = [ctypes.c_char_p]
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    connection = x11.XOpenDisplay(display.encode())
    if connection:
        x11.XCloseDisplay(connection)
    return bool(connection)


def _library_is_there(name: str) -> bool:
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


@dataclass(frozen=True)
class OpenGL:
    """What draws the meshes.

    Attributes:
        renderer: its name.
        version: such as ``4.5``.
        is_software: whether the processor does the drawing.
    """

    renderer: str
    version: str
    is_software: bool

    @property
    def multi_samples(self) -> int:
        """Samples a pixel for smooth outlines; by software they cost three times the drawing time, so there are none."""
        return 0 if self.is_software else 4


class OpenGLMissingError(Exception):
    """There is no OpenGL that the 3-D view could use; the text says so and what to do."""


def set_surface_format() -> None:
    """Choose the kind of OpenGL. Set after the first window was made, the 3-D view stays black."""
    from pyvistaqt.rwi import _default_format
    from qtpy.QtGui import QSurfaceFormat

    QSurfaceFormat.setDefaultFormat(_default_format())


def probe_opengl() -> OpenGL:
    """Return what OpenGL there is, tried on a surface that nobody sees.

    Raises:
        OpenGLMissingError: when there is none, or one older than 3.2.
    """
    from qtpy.QtGui import QOffscreenSurface, QOpenGLContext, QSurfaceFormat

    surface = QOffscreenSurface()
    surface.setFormat(QSurfaceFormat.defaultFormat())
    surface.create()
    context = QOpenGLContext()
    context.setFormat(QSurfaceFormat.defaultFormat())
    remedy = "Install the graphics driver, or Mesa's software rendering (Debian, Ubuntu: sudo apt install libgl1-mesa-dri)."
    if not context.create() or not surface.isValid() or not context.makeCurrent(surface):
        raise OpenGLMissingError(f"This display gives no OpenGL to draw the meshes with. {remedy} {_COMMAND_LINE}")
    try:
        major, minor = context.format().version()
        renderer = _gl_text(context, 0x1F01) or "unknown"
    finally:
        context.doneCurrent()
    if (major, minor) < (3, 2):
        raise OpenGLMissingError(
            f"The meshes need OpenGL 3.2; this display gives {major}.{minor} ({renderer}). {remedy} {_COMMAND_LINE}"
        )
    software = any(word in renderer.lower() for word in _SOFTWARE_RENDERERS)
    return OpenGL(renderer, f"{major}.{minor}", software)


def _gl_text(context: object, name: int) -> str:
    """Ask glGetString through the context; not every binding wraps the function."""
    address = context.getProcAddress(b"glGetString")  # type: ignore[attr-defined]
    if not address:
        return ""
    function = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_uint)(int(address))
    return (function(name) or b"").decode("utf-8", errors="replace")


def install_hooks(tell: Callable[[BaseException], None]) -> None:
    """Log every error that nobody caught, and tell it in the window; pass Qt's own messages to the log.

    Args:
        tell: called in the GUI thread for errors of slots.
    """
    from qtpy.QtCore import QMessageLogContext, QtMsgType, qInstallMessageHandler

    def on_exception(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if issubclass(kind, KeyboardInterrupt):
            sys.__excepthook__(kind, error, trace)
            return
        _LOG.error("Unexpected error", exc_info=(kind, error, trace))
        if threading.current_thread() is threading.main_thread():
            tell(error)

    def on_thread_exception(failure: threading.ExceptHookArgs) -> None:
        _LOG.error("Unexpected error in a thread", exc_info=failure.exc_value)

    levels = {
        QtMsgType.QtDebugMsg: logging.DEBUG, QtMsgType.QtInfoMsg: logging.INFO, QtMsgType.QtWarningMsg: logging.WARNING,
        QtMsgType.QtCriticalMsg: logging.ERROR, QtMsgType.QtFatalMsg: logging.CRITICAL,
    }  # fmt: skip

    def on_qt_message(kind: QtMsgType, _context: QMessageLogContext, text: str) -> None:
        _LOG.log(levels.get(kind, logging.WARNING), "Qt: %s", text)
        if kind in (QtMsgType.QtCriticalMsg, QtMsgType.QtFatalMsg):
            print(f"Qt: {text}", file=sys.stderr)

    sys.excepthook = on_exception
    threading.excepthook = on_thread_exception
    qInstallMessageHandler(on_qt_message)
